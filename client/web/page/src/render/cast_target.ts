// The textures that a picture is cast into: the surface's colour, the veil's colour and depth, the
// surface's depth. The bottom row comes first.

export class CastTarget {
  size: [number, number] = [0, 0];
  textures: WebGLTexture[] = []; // colour, veil colour, veil depth, depth; none before the first bind
  private framebuffer: WebGLFramebuffer | null = null;

  constructor(private readonly gl: WebGL2RenderingContext) {}

  // Binds it for drawing. Its content is lost if the size changes.
  bind(size: [number, number]): void {
    const gl = this.gl;
    if (size[0] !== this.size[0] || size[1] !== this.size[1]) this.resize(size);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.viewport(0, 0, ...size);
  }

  private resize(size: [number, number]): void {
    const gl = this.gl;
    for (const texture of this.textures) gl.deleteTexture(texture);
    gl.deleteFramebuffer(this.framebuffer);
    this.framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.activeTexture(gl.TEXTURE0);
    this.textures = [gl.RGBA8, gl.RGBA8, gl.R32F, gl.R32F].map((format, n) => {
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, format, ...size);
      // A coarse picture's colours are interpolated.
      const filter = format === gl.RGBA8 ? gl.LINEAR : gl.NEAREST;
      for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
      for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + n, gl.TEXTURE_2D, texture, 0);
      return texture;
    });
    gl.drawBuffers(this.textures.map((_, n) => gl.COLOR_ATTACHMENT0 + n));
    this.size = [...size];
  }
}
