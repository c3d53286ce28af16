// The textures that a picture is cast into: the surface's colour, the veil's colour and depth, the
// surface's depth. The bottom row comes first.

const kCount = 4;

export class CastTarget {
  size: [number, number] = [0, 0];
  // Colour, veil colour, veil depth, depth.
  textures: WebGLTexture[] = [];
  private framebuffer: WebGLFramebuffer | null = null;

  constructor(private readonly gl: WebGL2RenderingContext) {}

  // Binds it for drawing. Its content is lost if the size changes.
  bind(size: [number, number]): void {
    const gl = this.gl;
    if (size[0] !== this.size[0] || size[1] !== this.size[1]) this.resize(size);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.viewport(0, 0, ...size);
  }

  readDepths(): Float32Array {
    const gl = this.gl;
    const [width, height] = this.size;
    const texels = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    for (const name of [gl.PACK_ROW_LENGTH, gl.PACK_SKIP_PIXELS, gl.PACK_SKIP_ROWS]) gl.pixelStorei(name, 0);
    gl.readBuffer(gl.COLOR_ATTACHMENT3);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, texels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return texels.filter((_, n) => n % 4 === 0);
  }

  dispose(): void {
    for (const texture of this.textures) this.gl.deleteTexture(texture);
    this.gl.deleteFramebuffer(this.framebuffer);
    this.textures = [];
    this.framebuffer = null;
    this.size = [0, 0];
  }

  private resize(size: [number, number]): void {
    const gl = this.gl;
    this.dispose();
    this.framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.activeTexture(gl.TEXTURE0);
    for (let n = 0; n < kCount; ++n) {
      const texture = gl.createTexture();
      const isColor = n < 2;
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, isColor ? gl.RGBA8 : gl.R32F, ...size);
      // A coarse picture's colours are interpolated.
      const filter = isColor ? gl.LINEAR : gl.NEAREST;
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + n, gl.TEXTURE_2D, texture, 0);
      this.textures.push(texture);
    }
    gl.drawBuffers(this.textures.map((_, n) => gl.COLOR_ATTACHMENT0 + n));
    this.size = [...size];
  }
}
