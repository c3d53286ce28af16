// A daemon that streams anything to a viewer's copy of the volume.
//
//   step: kind u8, modulo 5
//     lattice    0  size 3 x i32, least and greatest value f64, type u8
//     placement  1  revision u64
//     overview   2  size 3 x i32, first u64, values
//     bricks     3  count u8 of number i32, type u8, count u8 of tiles (first i32, count i32,
//                   value f32), bricks left u32, values
//     complete   4  revision u64, hash u64; 0: the right one
//   values: u16; even: of half as many floats 0, 1, 2, ..; odd: half as many bytes, which
//           follow
#include <numeric>
#include <string>
#include <vector>

#include "client/sdk/volume_mirror.h"
#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"
#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {
namespace {

constexpr std::uint64_t kMostMirroredVoxels = 16 << 10;
constexpr int kMostEvents = 30;

class StreamScript {
 public:
  explicit StreamScript(std::span<const std::uint8_t> bytes) : input_(bytes) {}

  void Run() {
    for (int step = 0; step < kMostEvents && !input_.empty(); ++step) {
      try {
        mirror_.Apply(Event());
      } catch (const Error&) {
        FUZZ_CHECK(!mirror_.lattice() && !mirror_.resume());
      }
      Check();
    }
  }

 private:
  VolumeEvent Event() {
    switch (input_.Take<std::uint8_t>() % 5) {
      case 0: {
        VolumeLattice lattice;
        lattice.size = Size();
        lattice.value_min = input_.Take<double>();
        lattice.value_max = input_.Take<double>();
        lattice.type = kLeafTypes[input_.Take<std::uint8_t>() % 4];
        return lattice;
      }
      case 1:
        return VolumePlacement{{}, input_.Take<std::uint64_t>()};
      case 2: {
        VolumeOverview overview{Size(), input_.Take<std::uint64_t>(), {}};
        overview.zstd_values = Values();
        return overview;
      }
      case 3: {
        VolumeBricks bricks;
        bricks.numbers.resize(input_.Take<std::uint8_t>() % 16);
        for (auto& number : bricks.numbers) {
          number = static_cast<std::uint64_t>(input_.Take<std::int32_t>());
        }
        bricks.type = kLeafTypes[input_.Take<std::uint8_t>() % 4];
        bricks.tiles.resize(input_.Take<std::uint8_t>() % 8);
        for (VolumeTile& tile : bricks.tiles) {
          tile.bricks.first = static_cast<std::uint64_t>(input_.Take<std::int32_t>());
          tile.bricks.count = static_cast<std::uint64_t>(input_.Take<std::int32_t>());
          tile.value = input_.Take<float>();
        }
        bricks.bricks_left = input_.Take<std::uint32_t>();
        bricks.zstd_values = Values();
        return bricks;
      }
    }
    VolumeComplete complete{{1, input_.Take<std::uint64_t>()}, {}, {}};
    complete.content_hash.low = input_.Take<std::uint64_t>();
    complete.background_hash = BackgroundHash();
    if (complete.content_hash.low == 0) complete.content_hash = RightHash();
    return complete;
  }

  Vec3i Size() {
    Vec3i size;
    for (int axis = 0; axis < 3; ++axis) size[axis] = input_.Take<std::int32_t>();
    return size;
  }

  std::string Values() {
    const auto size = input_.Take<std::uint16_t>();
    if (size % 2 != 0) {
      const auto bytes = input_.TakeBytes(size / 2);
      return {bytes.begin(), bytes.end()};
    }
    std::vector<float> values(size / 2);
    std::iota(values.begin(), values.end(), 0.0f);
    return Compress(std::span<const float>(values));
  }

  ContentHash RightHash() const {
    ContentHash hash;
    const std::uint64_t count = mirror_.lattice() ? mirror_.lattice()->Bricks() : 0;
    for (std::uint64_t n = 0; n < count; ++n) {
      hash += HashOfBrick(mirror_.bricks().At(n)->Floats(), n);
    }
    return hash;
  }

  ContentHash BackgroundHash() const {
    ContentHash hash;
    if (!mirror_.lattice()) return hash;
    Brick background;
    background.fill(mirror_.lattice()->Background());
    for (std::uint64_t n = 0; n < mirror_.bricks().size(); ++n) hash += HashOfBrick(background, n);
    return hash;
  }

  void Check() {
    const auto& lattice = mirror_.lattice();
    if (!lattice) return;
    const Vec3i last = lattice->size - Vec3i::Ones();
    mirror_.bricks().Value(0, 0, 0);
    mirror_.bricks().Value(last.x(), last.y(), last.z());
    const Vec3i blocks = mirror_.overview_size();
    const auto overview = mirror_.overview();
    FUZZ_CHECK(overview.empty() || overview.size() == blocks.cast<std::uint64_t>().prod());
    for (const BrickRun& run : mirror_.TakeChanges().bricks) {
      FUZZ_CHECK(run.count > 0 && run.end() <= lattice->Bricks());
    }
  }

  Input input_;
  client::VolumeMirror mirror_{kMostMirroredVoxels};
};

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(volume_mirror_fuzz) {
  palpate::fuzz::StreamScript({data, size}).Run();
  return 0;
}
