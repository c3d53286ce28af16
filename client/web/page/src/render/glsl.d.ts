// The bundler reads these files as text.
declare module "*.glsl" {
  const text: string;
  export default text;
}
