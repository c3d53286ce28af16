// A program that covers the viewport with one triangle. Its fragment shader gets `share`: the place in the
// viewport, 0 to 1 along each axis.

const kVersion = "#version 300 es\n";
const kCoverViewport = `
out highp vec2 share;

void main() {
  share = vec2(gl_VertexID == 1 ? 2.0 : 0.0, gl_VertexID == 2 ? 2.0 : 0.0);
  gl_Position = vec4(2.0 * share - 1.0, 0.0, 1.0);
}
`;

function compile(gl: WebGL2RenderingContext, kind: number, source: string): WebGLShader {
  const shader = gl.createShader(kind)!; // null: not with these kinds
  gl.shaderSource(shader, kVersion + source);
  gl.compileShader(shader);
  return shader;
}

export class Program {
  private readonly program: WebGLProgram;
  private readonly noVertices: WebGLVertexArrayObject;
  private readonly places = new Map<string, WebGLUniformLocation | null>();
  private shaders: WebGLShader[]; // none: the program is ready

  constructor(
    private readonly gl: WebGL2RenderingContext,
    fragment: string,
  ) {
    this.program = gl.createProgram();
    this.noVertices = gl.createVertexArray();
    this.shaders = [compile(gl, gl.VERTEX_SHADER, kCoverViewport), compile(gl, gl.FRAGMENT_SHADER, fragment)];
    for (const shader of this.shaders) gl.attachShader(this.program, shader);
    gl.linkProgram(this.program);
  }

  // False while the driver compiles: some take seconds, during which the page goes on. Throws an Error with
  // the driver's words if it refuses the shader.
  isReady(): boolean {
    const { gl, program, shaders } = this;
    if (shaders.length === 0) return true;
    const parallel = gl.getExtension("KHR_parallel_shader_compile");
    if (parallel && !gl.getProgramParameter(program, parallel.COMPLETION_STATUS_KHR)) return false;
    const linked = gl.getProgramParameter(program, gl.LINK_STATUS) as boolean;
    const words = linked ? "" : `${gl.getShaderInfoLog(shaders[1])} ${gl.getProgramInfoLog(program)}`;
    for (const shader of shaders) gl.deleteShader(shader);
    this.shaders = [];
    if (!linked && !gl.isContextLost()) throw new Error(`the graphics driver refuses a shader: ${words}`);
    return linked;
  }

  use(): void {
    this.gl.useProgram(this.program);
  }

  // Sets a uniform of the program in use: one to four floats.
  set(name: string, ...values: number[]): void {
    this.gl[`uniform${values.length as 1 | 2 | 3 | 4}fv`](this.place(name), values);
  }

  // One to four ints, or a bool.
  setInt(name: string, ...values: number[]): void {
    this.gl[`uniform${values.length as 1 | 2 | 3 | 4}iv`](this.place(name), values);
  }

  // 3 x 3, column by column.
  setMatrix(name: string, columns: number[]): void {
    this.gl.uniformMatrix3fv(this.place(name), false, columns);
  }

  draw(): void {
    this.gl.bindVertexArray(this.noVertices);
    this.gl.drawArrays(this.gl.TRIANGLES, 0, 3);
    this.gl.bindVertexArray(null);
  }

  private place(name: string): WebGLUniformLocation | null {
    const place = this.places.get(name) ?? this.gl.getUniformLocation(this.program, name);
    this.places.set(name, place);
    return place;
  }
}
