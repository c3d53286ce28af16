// The servo goes on from keyframes: its own, its own with any bytes changed, and any
// bytes. Whatever is taken for a keyframe runs, and the same twice.
//
//   settings u8, method u8, isovalue u8, and then steps:
//     ticks     0  count u8, HIP 3 x i16 (thousandths of the lattice), reached in a line
//     changes   1  count u8, each an offset u16 and 8 bytes: of the state's own keyframe
//     fields    2  the same, but one byte each
//     bytes     3  size u16, the keyframe
//     scene     4  isovalue u8, bits u8: side, forces off, a new revision of the volume
#include <algorithm>
#include <memory>
#include <string>

#include "server/servo/tick_computation.h"
#include "tests/fuzz/haptic_script.h"

namespace palpate::fuzz {
namespace {

constexpr int kMostTicks = 6;
constexpr int kMostSteps = 20;

// Any surface but the script's.
void ForgetCells(TickComputation& ticks) {
  static const Scene other = [] {
    Scene scene;
    scene.volume = SmallVolume();
    scene.surface =
        MakeHapticSurface(*scene.volume, SmallPlacement(), 0.5, DecompositionMethod::kBcc, 0);
    return scene;
  }();
  ticks.Run(other, {});
}

TickComputation& Anew(int which) {
  static TickComputation ticks[] = {TickComputation({}), TickComputation({})};
  static const ServoKeyframe beginning = ticks[0].Keyframe();
  FUZZ_CHECK(ticks[which].Resume(beginning.view()));
  ForgetCells(ticks[which]);
  FUZZ_CHECK(ticks[which].Resume(beginning.view()));
  return ticks[which];
}

class Script {
 public:
  explicit Script(std::span<const std::uint8_t> bytes) : input_(bytes) {
    const auto bits = input_.Take<std::uint8_t>();
    HapticSettings& settings = scene_.settings;
    settings.static_friction = bits & 1 ? 0.6 : 0.0;
    settings.dynamic_friction = bits & 2 ? 0.4 : 0.0;
    settings.pop_force_n = bits & 4 ? 1.5 : 0.0;
    settings.force_shading = bits & 8;
    settings.passivity_control = bits & 16;
    settings.magnet_force_n = bits & 32 ? 1.0 : 0.0;
    settings.damping_n_s_per_m = bits & 64 ? 2.0 : 0.0;
    scene_.volume = SmallVolume();
    method_ = static_cast<DecompositionMethod>(input_.Take<std::uint8_t>() % 4);
    SetSurface(input_.Take<std::uint8_t>(), bits & 128 ? FreeSide::kAbove : FreeSide::kBelow);
  }

  void Run() {
    for (int step = 0; step < kMostSteps && !input_.empty(); ++step) {
      switch (input_.Take<std::uint8_t>() % 5) {
        case 0:
          Tick();
          break;
        case 1:
          Change(8);
          break;
        case 2:
          Change(1);
          break;
        case 3:
          Resume(TakeText(input_.Take<std::uint16_t>() % 1024));
          break;
        case 4:
          ChangeScene();
          break;
      }
    }
  }

 private:
  std::string TakeText(std::size_t size) {
    const auto bytes = input_.TakeBytes(size);
    return {bytes.begin(), bytes.end()};
  }

  void SetSurface(std::uint8_t isovalue, FreeSide side) {
    scene_.settings.free_side = side;
    scene_.surface =
        MakeHapticSurface(*scene_.volume, SmallPlacement(), isovalue / 255.0, method_, 1, side);
    scene_.isovalue = scene_.volume->Denormalize(isovalue / 255.0);
    ++scene_.scene_revision;
  }

  void Tick() {
    const int count = 1 + input_.Take<std::uint8_t>() % kMostTicks;
    Vec3 target_I;
    for (int axis = 0; axis < 3; ++axis) {
      target_I[axis] = (0.5 + input_.Take<std::int16_t>() * 1e-3) * scene_.volume->size()[axis];
    }
    const Vec3 target_D = SmallPlacement().Apply(target_I);
    for (int n = 0; n < count; ++n) {
      stylus_.p_DHip_mm += (target_D - stylus_.p_DHip_mm) / (count - n);
      const TickSample sample = ticks_.Run(scene_, {.stylus = stylus_});
      FUZZ_CHECK(IsSameSample(sample, again_.Run(scene_, {.stylus = stylus_})));
    }
  }

  void Change(std::size_t width) {
    std::string keyframe(ticks_.Keyframe().view());
    for (int left = input_.Take<std::uint8_t>() % 8; left >= 0; --left) {
      const std::size_t at = input_.Take<std::uint16_t>() % keyframe.size();
      const std::string bytes = TakeText(std::min(width, keyframe.size() - at));
      keyframe.replace(at, bytes.size(), bytes);
    }
    Resume(keyframe);
  }

  void Resume(const std::string& keyframe) {
    const std::string own(ticks_.Keyframe().view());
    // What the servo makes it takes.
    FUZZ_CHECK(again_.Resume(own));
    if (!ticks_.Resume(keyframe)) {
      FUZZ_CHECK(keyframe != own && ticks_.Keyframe().view() == own);
      return;
    }
    FUZZ_CHECK(ticks_.Keyframe().view() == keyframe);
    ForgetCells(again_);
    FUZZ_CHECK(again_.Resume(keyframe));
  }

  void ChangeScene() {
    const auto isovalue = input_.Take<std::uint8_t>();
    const auto bits = input_.Take<std::uint8_t>();
    scene_.forces_off = bits & 2;
    if (bits & 4) {
      const VolumeSnapshot& volume = *scene_.volume;
      scene_.volume = std::make_shared<const VolumeSnapshot>(
          volume.metadata(),
          bits & 8 ? volume.bricks().AllChangedAt(volume.revision() + 1) : volume.bricks(),
          volume.revision() + 1, volume.loaded_revision());
    }
    SetSurface(isovalue, bits & 1 ? FreeSide::kAbove : FreeSide::kBelow);
  }

  Input input_;
  Scene scene_;
  DecompositionMethod method_ = DecompositionMethod::kTpbcc;
  DeviceState stylus_;
  // Beside each other, the second with a cold cache from the last keyframe on. They are
  // large, and made once.
  TickComputation& ticks_ = Anew(0);
  TickComputation& again_ = Anew(1);
};

}  // namespace
}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  palpate::fuzz::Script({data, size}).Run();
  return 0;
}
