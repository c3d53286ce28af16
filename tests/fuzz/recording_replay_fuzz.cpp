// A recording that may hold anything, computed again through the tick.
//
// Not from a file: hashes of volumes are made to fit.
//
//   step: kind u8, modulo 6; bit 7: the scene's hash stays as it is
//     scene     0  size u16, RecordedScene
//     keyframe  1  size u16, state of the servo
//     ticks     2  count u8, flags u16, HIP 3 x f32 (mm)
//     edit      3  brick u8, 4 x f32, over and over
//     sample    4  size u16, RecordedTick
//     gap       5  first u64, last u64
#include <array>
#include <cmath>
#include <memory>
#include <string>

#include "common/wire/values.h"
#include "server/recording/bytes.h"
#include "server/recording/recorded_messages.h"
#include "server/recording/replayer.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/made_volume.h"

namespace palpate::fuzz {
namespace {

constexpr int kMostTicks = 6;
constexpr int kMostSteps = 24;

// Eight bricks, most of them partly beyond the lattice, with flat regions, slopes, ties and edges.
std::shared_ptr<const VolumeSnapshot> SmallVolume() {
  static const auto volume = testing::MakeVolume({12, 10, 9}, [](int i, int j, int k) {
    if (i < 3) return j < 5 ? 0.0 : 8.0;
    if (k > 6) return static_cast<double>((i * 7 + j * 5 + k * 3) % 9);
    return 4.0 + 4.0 * std::sin(0.9 * i) * std::cos(0.8 * j) + 0.5 * k;
  });
  return volume;
}

std::shared_ptr<const VolumeSnapshot> Load(const RecordedScene&) { return SmallVolume(); }

class ReplayScript {
 public:
  explicit ReplayScript(std::span<const std::uint8_t> bytes) : input_(bytes) {}

  void Run() {
    for (int step = 0; step < kMostSteps && !input_.empty(); ++step) {
      const auto kind = input_.Take<std::uint8_t>();
      switch (kind % 6) {
        case 0:
          TakeScene(kind & 128);
          break;
        case 1:
          TakeKeyframe();
          break;
        case 2:
          TakeTicks();
          break;
        case 3:
          TakeEdit();
          break;
        case 4:
          replayer_.Take(
              RecordedItem(RecordedSamples{SampleOf(FromProto(TakeMessage<v1::RecordedTick>()))}));
          break;
        case 5:
          TakeGap();
          break;
      }
      const ReplayCounts& counts = replayer_.counts();
      FUZZ_CHECK(counts.compared + counts.without_start + counts.without_scene +
                     counts.without_volume ==
                 counts.ticks);
      FUZZ_CHECK(counts.differing <= counts.compared);
    }
  }

 private:
  std::string TakeText() {
    const auto bytes = input_.TakeBytes(input_.Take<std::uint16_t>());
    return {bytes.begin(), bytes.end()};
  }

  template <class Message>
  Message TakeMessage() {
    Message message;
    if (!message.ParseFromString(TakeText())) throw DamagedBytes("no message");
    return message;
  }

  // With the hash of the volume that the edits lead to, as a recorder would.
  void TakeScene(bool keeps_hash) {
    RecordedScene scene = FromProto(TakeMessage<v1::RecordedScene>());
    if (loaded_revision_ != scene.loaded_revision) {
      volume_ = SmallVolume();
      loaded_revision_ = base_revision_ = scene.loaded_revision;
    }
    if (!keeps_hash) {
      const bool fits = !edits_.empty() && !scene.voxels_missing &&
                        edits_.front().base_revision == base_revision_;
      if (fits) volume_ = WithEdits(*volume_, edits_);
      if (!edits_.empty()) base_revision_ = scene.volume_revision;
      scene.volume_hash = HashVolume(*volume_);
    }
    edits_.clear();
    scene_revision_ = scene.scene_revision;
    replayer_.Take(RecordedItem(scene));
  }

  void TakeEdit() {
    RecordedEdit edit;
    edit.base_revision = base_revision_;
    edit.volume_revision = base_revision_ + 1;
    edit.bricks.push_back({input_.Take<std::uint8_t>() % std::uint64_t{9}});
    Brick values{};
    std::array<float, 4> pattern;
    for (float& value : pattern) value = input_.Take<float>();
    for (std::size_t n = 0; n < values.size(); ++n) values[n] = pattern[(n + (n >> 3)) % 4];
    edit.bricks.back().values = Leaf::Smallest(values);
    replayer_.Take(RecordedItem(edit));
    edits_.push_back(std::move(edit));
  }

  void TakeGap() {
    RecordedGap gap;
    gap.first_tick = input_.Take<std::uint64_t>();
    gap.last_tick = input_.Take<std::uint64_t>();
    replayer_.Take(RecordedItem(gap));
  }

  void TakeTicks() {
    RecordedSamples samples(1 + input_.Take<std::uint8_t>() % kMostTicks);
    const auto flags = input_.Take<std::uint16_t>();
    TickSample sample;
    sample.scene_revision = scene_revision_;
    for (double& mm : sample.hip_mm) mm = input_.Take<float>();
    sample.input_rejected = flags & 1;
    sample.docked = flags & 2;
    sample.calibrated = !(flags & 4);
    sample.buttons = flags >> 3 & 3;
    sample.force_command = static_cast<ForceCommand>(1 + (flags >> 5 & 3));
    sample.device_status = static_cast<DeviceStatus>(1 + (flags >> 7 & 3) % 3);
    sample.missed_ticks = flags >> 9;
    for (TickSample& one : samples) one = sample;
    replayer_.Take(RecordedItem(samples));
  }

  void TakeKeyframe() {
    RecordedKeyframe keyframe{.state = TakeText()};
    // As the state says: the tick is the fourth number from its end.
    constexpr std::size_t kFromEnd = 4 * sizeof keyframe.tick;
    if (keyframe.state.size() >= kFromEnd) {
      std::memcpy(&keyframe.tick, keyframe.state.data() + keyframe.state.size() - kFromEnd,
                  sizeof keyframe.tick);
    }
    replayer_.Take(RecordedItem(keyframe));
  }

  Input input_;
  Replayer replayer_{Load};
  std::uint64_t scene_revision_ = 0;
  // As the replayer follows them.
  std::shared_ptr<const VolumeSnapshot> volume_ = SmallVolume();
  std::uint64_t loaded_revision_ = 0;
  std::uint64_t base_revision_ = 0;
  std::vector<RecordedEdit> edits_;
};

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(recording_replay_fuzz) {
  using namespace palpate;
  try {
    // Too large for a stack.
    std::make_unique<fuzz::ReplayScript>(std::span(data, size))->Run();
  } catch (const Error&) {
  } catch (const DamagedBytes&) {
  }
  return 0;
}
