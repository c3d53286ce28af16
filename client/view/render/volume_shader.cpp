#include "client/view/render/volume_shader.h"

#include <epoxy/gl.h>

namespace palpate::view {

const char* const kShaderVolume = R"(
// Values are scaled as in value_scale.h. The buffers are those of brick_cache.h: of a block, its
// range as bits, its table and its coarse slot; of a cell brick in a table, its range and slot.
uniform ATLAS atlas;
uniform usamplerBuffer blocks;
uniform samplerBuffer ranges;
uniform usamplerBuffer slots;
uniform float texel_factor;  // from texels to scaled values
uniform float background;
uniform ivec3 block_count;
uniform ivec3 cells;  // along each axis

layout(std430, binding = 0) buffer Marks { uint marks[]; };

const uint kNone = 0xFFFFFFFFu;

// True if a cell brick was missing that this pixel wants.
bool is_unfinished = false;

float Texel(ivec3 at) { return float(texelFetch(atlas, at, 0).r) * texel_factor; }

// In texels, whose axes are those of the lattice in reverse.
ivec3 SlotOrigin(uint slot) { return 9 * ivec3(slot & 63u, slot >> 6 & 63u, slot >> 12); }

uvec4 BlockAt(ivec3 block) {
  return texelFetch(blocks, (block.x * block_count.y + block.y) * block_count.z + block.z);
}
vec2 RangeOf(uvec4 block) { return uintBitsToFloat(block.xy); }

// Of a cell brick in a block with a table.
int EntryOf(uvec4 block, ivec3 brick) {
  ivec3 place = brick & 7;
  return int(block.z) * 512 + (place.x << 6 | place.y << 3 | place.z);
}

// Marks a cell brick as wanted, and returns its slot.
uint WantedSlot(int entry) {
  uint bit = 1u << (entry & 31);
  if ((marks[entry >> 5] & bit) == 0u) atomicOr(marks[entry >> 5], bit);
  uint slot = texelFetch(slots, entry).r;
  if (slot == kNone) is_unfinished = true;
  return slot;
}

// Values at the corners of a cell: `low` at its lower x, `high` at its upper x. Each has (y, z) =
// (0, 0), (0, 1), (1, 0), (1, 1).
struct Corners {
  vec4 low;
  vec4 high;
};

// From the texel of the cell's first corner on.
Corners CornersAt(ivec3 t) {
  return Corners(vec4(Texel(t), Texel(t + ivec3(1, 0, 0)), Texel(t + ivec3(0, 1, 0)),
                      Texel(t + ivec3(1, 1, 0))),
                 vec4(Texel(t + ivec3(0, 0, 1)), Texel(t + ivec3(1, 0, 1)),
                      Texel(t + ivec3(0, 1, 1)), Texel(t + ivec3(1, 1, 1))));
}

ivec3 CellAt(vec3 p) { return clamp(ivec3(floor(p)), ivec3(0), cells - 1); }

// The cell at a point, as it can be drawn: a coarse one spans a cell brick.
struct Cell {
  Corners corners;
  vec3 u;      // the point within it, 0 to 1
  float edge;  // 1 or 8
};

// The range of the cell brick at a point.
vec2 RangeAt(vec3 p) {
  ivec3 brick = CellAt(p) >> 3;
  uvec4 block = BlockAt(brick >> 3);
  return block.z == kNone ? RangeOf(block) : texelFetch(ranges, EntryOf(block, brick)).rg;
}

Cell CellOf(vec3 p) {
  ivec3 cell = CellAt(p);
  ivec3 brick = cell >> 3;
  uvec4 block = BlockAt(brick >> 3);
  vec2 range = RangeOf(block);
  int entry = EntryOf(block, brick);
  if (block.z != kNone) range = texelFetch(ranges, entry).rg;
  if (range.x == range.y) return Cell(Corners(vec4(range.x), vec4(range.x)), vec3(0.0), 1.0);
  uint slot = WantedSlot(entry);
  bool is_fine = slot != kNone;
  ivec3 low = is_fine ? cell : brick << 3;
  float edge = is_fine ? 1.0 : 8.0;
  ivec3 texel = SlotOrigin(is_fine ? slot : block.w) + ((is_fine ? cell : brick) & 7).zyx;
  return Cell(CornersAt(texel), clamp((p - vec3(low)) / edge, 0.0, 1.0), edge);
}
)";

namespace {

constexpr const char* kAtlasSamplers[] = {"usampler3D", "isampler3D", "usampler3D", "sampler3D"};

void Bind(int unit, GLenum kind, unsigned texture) {
  glActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + unit));
  glBindTexture(kind, texture);
}

}  // namespace

const ShaderProgram& VolumePrograms::Use(const BrickCache& volume) {
  const LeafType type = volume.atlas().type();
  const auto number = static_cast<std::size_t>(type);
  std::unique_ptr<ShaderProgram>& program = programs_[number];
  if (!program) {
    program = std::make_unique<ShaderProgram>("#version 430 core\n#define ATLAS " +
                                              std::string(kAtlasSamplers[number]) + "\n" +
                                              kShaderVolume + kShaderCell + fragment_source_);
  }
  Bind(3, GL_TEXTURE_BUFFER, volume.slots().texture());
  Bind(2, GL_TEXTURE_BUFFER, volume.ranges().texture());
  Bind(1, GL_TEXTURE_BUFFER, volume.blocks().texture());
  Bind(0, GL_TEXTURE_3D, volume.atlas().texture());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, volume.marks().buffer());
  program->Use();
  program->Set("atlas", 0);
  program->Set("blocks", 1);
  program->Set("ranges", 2);
  program->Set("slots", 3);
  // Floats are stored scaled. A factor that is a power of two changes no digit.
  program->Set("texel_factor",
               type == LeafType::kFloat ? 1.0 : static_cast<double>(volume.scale().factor()));
  program->Set("background", static_cast<double>(volume.background()));
  program->Set("block_count", volume.block_count());
  program->Set("cells", Vec3i(volume.size() + Vec3i::Ones()));
  return *program;
}

}  // namespace palpate::view
