// Begins: with the recording in the page, one that a server poses, or what a server plays.

(async () => {
  const message = element('message');
  try {
    if (typeof DecompressionStream === 'undefined')
      throw Error('This browser cannot unpack the recording; any version of Firefox, Chrome, Edge or Safari since 2023 can.');
    const recording = await openRecording();
    let player;
    if (recording instanceof LiveRecording) {
      const early = [];
      await recording.connect(heard => (player ? player.heard(heard) : early.push(heard)));
      player = new LivePlayer(recording);
      early.forEach(heard => player.heard(heard));
    } else {
      player = new Player(recording);
      player.play(!matchMedia('(prefers-reduced-motion: reduce)').matches);
    }
    // For programs that drive the page.
    globalThis.crowdsimPlayer = player;
  } catch (error) {
    message.textContent = error.message;
    message.hidden = false;
    document.documentElement.dataset.state = 'failed';
  }
})();
