#include "client/view/render/shader_program.h"

#include <epoxy/gl.h>

#include <utility>

#include "client/shading/shading.h"
#include "client/view/render/gl_state.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

constexpr const char* kCoverViewport = R"(#version 430 core
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}
)";

GLuint Compile(GLenum kind, const char* source) {
  const GLuint shader = glCreateShader(kind);
  glShaderSource(shader, 1, &source, nullptr);
  glCompileShader(shader);
  GLint good = GL_FALSE;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
  if (good == GL_TRUE) return shader;
  char log[2048] = {};
  glGetShaderInfoLog(shader, sizeof(log), nullptr, log);
  glDeleteShader(shader);
  throw Error(ErrorKind::kInternal, std::string("the graphics driver refuses a shader: ") + log);
}

GLuint Link(GLuint vertex, GLuint fragment) {
  const GLuint program = glCreateProgram();
  glAttachShader(program, vertex);
  glAttachShader(program, fragment);
  glLinkProgram(program);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
  GLint good = GL_FALSE;
  glGetProgramiv(program, GL_LINK_STATUS, &good);
  if (good == GL_TRUE) return program;
  char log[2048] = {};
  glGetProgramInfoLog(program, sizeof(log), nullptr, log);
  glDeleteProgram(program);
  throw Error(ErrorKind::kInternal, std::string("the graphics driver refuses a program: ") + log);
}

}  // namespace

ShaderProgram::ShaderProgram(const std::string& fragment_source)
    : ShaderProgram(kCoverViewport, fragment_source) {}

ShaderProgram::ShaderProgram(const std::string& vertex_source, const std::string& fragment_source) {
  const GLuint vertex = Compile(GL_VERTEX_SHADER, vertex_source.c_str());
  program_ = Link(vertex, Compile(GL_FRAGMENT_SHADER, fragment_source.c_str()));
  glGenVertexArrays(1, &no_vertices_);
}

ShaderProgram::~ShaderProgram() {
  glDeleteProgram(program_);
  glDeleteVertexArrays(1, &no_vertices_);
}

void ShaderProgram::Use() const { glUseProgram(program_); }

void ShaderProgram::Set(const char* name, int value) const {
  glUniform1i(glGetUniformLocation(program_, name), value);
}

void ShaderProgram::Set(const char* name, double value) const {
  glUniform1f(glGetUniformLocation(program_, name), static_cast<float>(value));
}

void ShaderProgram::Set(const char* name, const Vec3i& value) const {
  glUniform3iv(glGetUniformLocation(program_, name), 1, value.data());
}

void ShaderProgram::SetFloats(const char* name, const float* floats, int count) const {
  const GLint place = glGetUniformLocation(program_, name);
  if (count == 2) glUniform2fv(place, 1, floats);
  if (count == 3) glUniform3fv(place, 1, floats);
  if (count == 4) glUniform4fv(place, 1, floats);
  if (count == 9) glUniformMatrix3fv(place, 1, GL_FALSE, floats);
  if (count == 16) glUniformMatrix4fv(place, 1, GL_FALSE, floats);
}

void ShaderProgram::Draw() const {
  glBindVertexArray(no_vertices_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

namespace {

constexpr const char* kAtlasSamplers[] = {"usampler3D", "isampler3D", "usampler3D", "sampler3D"};

}  // namespace

VolumePrograms::VolumePrograms(std::string fragment_source)
    : fragment_source_(std::move(fragment_source)), colors_(NewTexture(GL_RGBA8, {256, 1})) {}

VolumePrograms::~VolumePrograms() { glDeleteTextures(1, &colors_); }

const ShaderProgram& VolumePrograms::Use(const BrickCache& volume, ColorMap map) {
  const LeafType type = volume.atlas().type();
  const auto number = static_cast<std::size_t>(type);
  std::unique_ptr<ShaderProgram>& program = programs_[number];
  if (!program) {
    program = std::make_unique<ShaderProgram>(
        "#version 430 core\n#define ATLAS " + std::string(kAtlasSamplers[number]) + "\n" +
        shading::kVolumeDesktop + shading::kCell + fragment_source_);
  }
  BindTexture(4, GL_TEXTURE_2D, colors_);
  if (shown_ != map) {
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, 256, 1, GL_RGBA, GL_UNSIGNED_BYTE,
                    ColorTable(map).data());
    shown_ = map;
  }
  BindTexture(3, GL_TEXTURE_BUFFER, volume.slots().texture());
  BindTexture(2, GL_TEXTURE_BUFFER, volume.ranges().texture());
  BindTexture(1, GL_TEXTURE_BUFFER, volume.blocks().texture());
  BindTexture(0, GL_TEXTURE_3D, volume.atlas().texture());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, volume.marks().buffer());
  program->Use();
  program->Set("atlas", 0);
  program->Set("blocks", 1);
  program->Set("ranges", 2);
  program->Set("slots", 3);
  program->Set("color_map", 4);
  // Floats are stored scaled. A factor that is a power of two changes no digit.
  program->Set("texel_factor", type == LeafType::kFloat ? 1.0 : volume.scale().factor());
  program->Set("background", static_cast<double>(volume.background()));
  program->Set("block_count", volume.block_count());
  program->Set("cells", volume.size() + Vec3i::Ones());
  return *program;
}

}  // namespace palpate::view
