"""Control on a GPU: threads that call the kernels of ``crowd.kernels``, memory, compiled code, and a frame's stages."""
