// Cameras: those that were planned for the crowd, and those that the viewer moves.

const FIELD = 36 * Math.PI / 180, EYE_FIELD = 70 * Math.PI / 180, WIDE = 16 / 9;
const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross3 = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

// An eye in the world, for a picture of some size in CSS pixels.
class View {
  constructor(eye, ahead, field, haze, width, height) {
    const length = Math.hypot(...ahead) || 1;
    this.eye = eye;
    this.ahead = ahead.map(value => value / length);
    const level = Math.hypot(this.ahead[0], this.ahead[2]);
    // Straight down, the top of the picture lies towards +z, as in pictures that crowdsim renders.
    const azimuth = level > 1e-6 ? Math.atan2(this.ahead[0], this.ahead[2]) : 0;
    this.right = [-Math.cos(azimuth), 0, Math.sin(azimuth)];
    this.up = cross3(this.right, this.ahead);
    Object.assign(this, { field, haze, width, height });
    this.tall = Math.tan(field / 2);
    this.wide = this.tall * width / height;
    this.focal = 0.5 * height / this.tall;
  }

  // Pixels a metre at a point; 0 where a ball about it is out of the picture.
  pixels(x, y, z, radius) {
    const e = this.eye, p = [x - e[0], y - e[1], z - e[2]], depth = dot3(p, this.ahead);
    if (depth < -radius) return 0;
    if (Math.abs(dot3(p, this.right)) - this.wide * depth > radius * Math.hypot(1, this.wide)) return 0;
    if (Math.abs(dot3(p, this.up)) - this.tall * depth > radius * Math.hypot(1, this.tall)) return 0;
    return this.focal / Math.max(depth, 0.3);
  }

  // Where a point is in the picture, and how far ahead; null behind the eye.
  project(x, y, z) {
    const e = this.eye, p = [x - e[0], y - e[1], z - e[2]], depth = dot3(p, this.ahead);
    if (depth < 0.05) return null;
    return [
      0.5 * this.width + this.focal * dot3(p, this.right) / depth,
      0.5 * this.height - this.focal * dot3(p, this.up) / depth,
      depth,
    ];
  }

  // The direction of the ray through a point of the picture.
  ray(px, py) {
    const x = (px - 0.5 * this.width) / this.focal, y = (0.5 * this.height - py) / this.focal;
    const way = [0, 1, 2].map(i => this.ahead[i] + x * this.right[i] + y * this.up[i]), length = Math.hypot(...way);
    return way.map(value => value / length);
  }
}

const hazeFor = distance => Math.max(3.6 * distance, 34);

class Camera {
  constructor(scene) {
    this.scene = scene;
    this.choices = [
      ...scene.cameras.map((camera, i) => ({ name: camera.name, kind: 'track', track: scene.tables[`camera_${i}`], camera })),
      { name: 'free', kind: 'free' },
      { name: 'follow the avatar', kind: 'follow' },
      { name: 'eyes of the avatar', kind: 'eye' },
    ];
    // Tracks that take long to plan come when they are chosen.
    this.choice = this.choices.findIndex(choice => choice.kind !== 'track' || choice.track);
    this.avatar = 0;
    // The eye is at `distance` from `target`, in the direction of `yaw` and `pitch`.
    this.orbit = { target: [0, 1, 0], yaw: 0, pitch: 0.4, distance: 12, field: FIELD };
    this.followed = null;
    this.aside = 0;
  }

  get kind() { return this.choices[this.choice].kind; }

  find(kind) { return this.choices.findIndex(choice => choice.kind === kind); }

  choose(choice, view) {
    if (this.choices[choice].kind === 'free' && view) this.free(view);
    else if (this.choices[choice].kind === 'follow') this.follow();
    this.choice = choice;
  }

  // Follows an avatar as the camera `follow` does: from behind its shoulder.
  follow() {
    const tall = this.scene.tables.height[this.avatar] || 1.7;
    Object.assign(this.orbit, { distance: 3.37 * tall, pitch: 0.317, field: FIELD });
    this.followed = null;
    this.aside = -0.3;
  }

  // Leaves a planned camera where it is, to be moved from there.
  free(view) {
    const distance = this.kind === 'follow' ? this.orbit.distance : clamp(
      view.ahead[1] < -0.02 ? (view.eye[1] - 1) / -view.ahead[1] : 10, 1, 400);
    this.orbit = {
      target: view.eye.map((value, i) => value + view.ahead[i] * distance), distance, field: view.field,
      yaw: Math.atan2(-view.ahead[0], -view.ahead[2]), pitch: Math.asin(clamp(-view.ahead[1], -1, 1)),
    };
    // From straight above, what is up in the picture stays so.
    if (Math.hypot(view.ahead[0], view.ahead[2]) < 1e-3) this.orbit.yaw = Math.PI;
    this.choice = this.find('free');
  }

  // Begins to move the camera by hand: one that follows an avatar goes on with that.
  grab(view) {
    if (this.kind !== 'free' && this.kind !== 'follow') this.free(view);
  }

  turn(yaw, pitch) {
    if (this.kind === 'follow') this.aside += yaw;
    else this.orbit.yaw += yaw;
    this.orbit.pitch = clamp(this.orbit.pitch + pitch, -0.05, 1.5533);
  }

  // Moves the target over the floor, right and ahead as seen in the picture [m].
  pan(right, ahead) {
    if (this.kind === 'follow') this.choice = this.find('free');
    const { yaw, target } = this.orbit, sin = Math.sin(yaw), cos = Math.cos(yaw);
    target[0] += right * cos - ahead * sin;
    target[2] += -right * sin - ahead * cos;
  }

  zoom(factor) { this.orbit.distance = clamp(this.orbit.distance * factor, 0.4, 2000); }

  view(crowd, seconds, passed, width, height) {
    const kind = this.kind, root = 3 * this.avatar, there = Number.isFinite(crowd.roots[root]);
    if (kind === 'track') return this.planned(this.choices[this.choice].track, seconds, width, height);
    if (kind === 'eye' && there && Number.isFinite(crowd.heads[root])) {
      const look = [...crowd.facing.subarray(root, root + 3)], head = crowd.heads.subarray(root, root + 3);
      return new View([...head].map((value, i) => value + 0.16 * look[i]), look, EYE_FIELD, 90, width, height);
    }
    const orbit = this.orbit;
    if (kind === 'follow' && there) {
      const tall = this.scene.tables.height[this.avatar], f = crowd.facing;
      // An avatar that lies looks at the sky: the camera stays where it was.
      const lies = Math.hypot(f[root], f[root + 2]) < 0.4 && this.followed;
      const heading = lies ? this.followed.heading : Math.atan2(f[root], f[root + 2]);
      const at = [crowd.roots[root], crowd.roots[root + 2]];
      if (!this.followed) this.followed = { at, heading };
      const seen = this.followed, near = 1 - Math.exp(-passed / 0.35), slow = 1 - Math.exp(-passed / 0.8);
      const turn = Math.atan2(Math.sin(heading - seen.heading), Math.cos(heading - seen.heading));
      seen.heading += turn * slow;
      seen.at = seen.at.map((value, i) => value + (at[i] - value) * near);
      orbit.target = [seen.at[0] + 0.7 * tall * Math.sin(seen.heading), 0.5 * tall,
        seen.at[1] + 0.7 * tall * Math.cos(seen.heading)];
      orbit.yaw = seen.heading + Math.PI + this.aside;
    }
    const cos = Math.cos(orbit.pitch), way = [Math.sin(orbit.yaw) * cos, Math.sin(orbit.pitch), Math.cos(orbit.yaw) * cos];
    const eye = orbit.target.map((value, i) => value + way[i] * orbit.distance);
    eye[1] = Math.max(eye[1], 0.06);
    const ahead = orbit.target.map((value, i) => value - eye[i]);
    return new View(eye, ahead, orbit.field, hazeFor(orbit.distance), width, height);
  }

  planned(track, seconds, width, height) {
    const last = track.length / 9 - 1, at = clamp((seconds - this.scene.first / this.scene.fps) / this.scene.track_step, 0, last);
    const low = Math.floor(at), high = Math.min(low + 1, last), cut = track[9 * low + 8], row = [];
    const part = cut < 0 ? at - low : at - low < cut ? 0 : 1;
    for (let i = 0; i < 8; i++) row.push(track[9 * low + i] * (1 - part) + track[9 * high + i] * part);
    // It was planned for a wide picture: a narrow one must see as much from left to right.
    const tall = Math.tan(row[6] / 2) * Math.max(1, WIDE * height / width);
    return new View(row.slice(0, 3), row.slice(3, 6), 2 * Math.atan(tall), row[7], width, height);
  }

  // The present camera as a scenario, or a file that `crowdsim render --camera FILE.yaml#view` reads, has it.
  yaml(view) {
    const choice = this.choices[this.choice], names = this.scene.names, number = value => Number(value.toFixed(3));
    let keys = {};
    if (choice.kind === 'track') ({ ...keys } = choice.camera);
    else if (choice.kind === 'eye') keys = { kind: 'eye', avatar: names[this.avatar] };
    else if (choice.kind === 'follow' && Math.abs(this.aside + 0.3) < 1e-6) {
      const tall = this.scene.tables.height[this.avatar], { distance, pitch } = this.orbit;
      keys = { kind: 'follow', avatar: names[this.avatar], distance: number(distance * Math.cos(pitch) - 0.7 * tall),
        height: number(0.5 * tall + distance * Math.sin(pitch)) };
      keys.distance = Math.max(keys.distance, 0.3);
      keys.height = Math.max(keys.height, 0.05);
    } else {
      const target = view.eye.map((value, i) => value + view.ahead[i] * this.orbit.distance);
      keys = { kind: 'fixed', position: view.eye.map(number) };
      if (choice.kind === 'follow') keys.avatar = names[this.avatar];
      else keys.look_at = target.map(number);
      keys.lens = { field_of_view: Number((view.field * 180 / Math.PI).toFixed(2)) };
    }
    const name = choice.kind === 'track' ? choice.camera.name : 'view';
    delete keys.name;
    return `cameras:\n  ${/^[A-Za-z_][\w-]*$/.test(name) ? name : JSON.stringify(name)}: ${flow(keys)}\n`;
  }
}

// Plain data as YAML in one line.
function flow(value) {
  if (Array.isArray(value)) return `[${value.map(flow).join(', ')}]`;
  if (value !== null && typeof value === 'object')
    return `{${Object.entries(value).map(([key, one]) => `${key}: ${flow(one)}`).join(', ')}}`;
  if (typeof value === 'string' && !/^[A-Za-z][A-Za-z0-9_-]*$/.test(value)) return JSON.stringify(value);
  if (typeof value === 'string' && /^(y|n|yes|no|on|off|true|false|null)$/i.test(value)) return JSON.stringify(value);
  return String(value);
}
