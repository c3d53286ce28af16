#include "server/lab/old_recording.h"

#include <xxhash.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <string_view>
#include <type_traits>
#include <utility>

#include "common/error/error.h"
#include "server/recording/bytes.h"
#include "server/recording/sample_fields.h"

namespace palpate::lab {
namespace {

constexpr std::string_view kOldMagic = "\x89PLPREC\n";
constexpr std::uint32_t kOldestVersion = 2, kFirstClockVersion = 6, kNewestVersion = 6;
constexpr std::size_t kHeaderStartBytes = 8 + 4 + 4 + 8;
constexpr std::size_t kChunkStartBytes = 8 + 8 + 2 + 2 + 4 + 4;
constexpr std::size_t kChecksumBytes = 8;
constexpr std::size_t kMostProgramBytes = 256;
constexpr std::size_t kMostPayloadBytes = std::size_t{16} << 20;
constexpr std::size_t kBricksPerEdit = 4096;
enum Type : std::uint16_t { kSamples = 1, kScene, kEdit, kMarker, kGap, kKeyframe, kEnd };

std::uint64_t Checksum(std::string_view bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

[[noreturn]] void RefuseFile(const std::string& file, const std::string& why) {
  throw Error(ErrorKind::kInvalidArgument, file + " " + why);
}

// The fields of a version before MCAP.
template <class Visit>
void VisitOldFields(TickSample& sample, Visit&& visit) {
  VisitFields(sample, [&](std::string_view name, auto& field) {
    constexpr std::array kLater = {"led_",          "series_",    "push_",         "torque_",
                                   "force_torque_", "refinement", "layers_passed", "contact_layer",
                                   "tool_",         "touching_",  "hand"};
    if (std::ranges::none_of(kLater, [&](auto later) { return name.starts_with(later); })) {
      visit(field);
    }
  });
}

template <class Field>
void FromWord(std::uint64_t word, Field& field) {
  if constexpr (std::is_enum_v<Field>) {
    // Files number enumerators from 0.
    if (word >= kWords<Field>.size()) throw DamagedBytes("damaged: a field is out of its range");
    field = static_cast<Field>(word + 1);
  } else if constexpr (std::is_same_v<Field, bool>) {
    if (word > 1) throw DamagedBytes("damaged: a field is out of its range");
    field = word != 0;
  } else {
    std::memcpy(&field, &word, sizeof field);
  }
}

// Each field is a column: differences to the number before, their sign in the lowest bit, and bytes
// of equal weight together.
RecordedSamples SamplesOf(ByteReader& reader) {
  const std::size_t count = reader.Get<std::uint32_t>();
  if (count == 0 || count > kSamplesPerChunk) throw DamagedBytes("damaged: too many samples");
  RecordedSamples samples(count);
  std::array<std::string_view, 80> columns;
  std::size_t fields = 0;
  VisitOldFields(samples.front(), [&](auto& field) {
    columns.at(fields++) = reader.GetBytes(sizeof field * count);
  });
  std::array<std::uint64_t, columns.size()> last{};
  for (std::size_t n = 0; n < count; ++n) {
    std::size_t f = 0;
    VisitOldFields(samples[n], [&](auto& field) {
      std::uint64_t folded = 0;
      for (std::size_t k = 0; k < sizeof field; ++k) {
        folded |= std::uint64_t{static_cast<unsigned char>(columns[f][k * count + n])} << (8 * k);
      }
      constexpr std::uint64_t kMask = ~std::uint64_t{0} >> (64 - 8 * sizeof field);
      const std::uint64_t difference = (folded >> 1) ^ (~(folded & 1) + 1);
      last[f] = (last[f] + difference) & kMask;
      FromWord(last[f++], field);
    });
    if (samples[n].tick != samples[0].tick + n) throw DamagedBytes("damaged: ticks are missing");
  }
  return samples;
}

// The four bytes of each voxel are in four planes, the lowest bytes of all voxels first.
RecordedEdit EditOf(ByteReader& reader) {
  RecordedEdit edit;
  edit.tick = reader.Get<std::uint64_t>();
  edit.base_revision = reader.Get<std::uint64_t>();
  edit.volume_revision = reader.Get<std::uint64_t>();
  const auto count = reader.Get<std::uint32_t>();
  if (count == 0 || count > kBricksPerEdit) throw DamagedBytes("damaged: too many bricks");
  edit.bricks.resize(count);
  for (RecordedBrick& brick : edit.bricks) brick.number = reader.Get<std::uint64_t>();
  const std::size_t voxels = std::size_t{count} * kBrickVoxels;
  const std::string_view planes = reader.GetBytes(voxels * sizeof(float));
  std::size_t at = 0;
  for (RecordedBrick& brick : edit.bricks) {
    Brick values;
    for (float& value : values) {
      std::array<char, sizeof value> bytes;
      for (std::size_t k = 0; k < bytes.size(); ++k) bytes[k] = planes[k * voxels + at];
      std::memcpy(&value, bytes.data(), sizeof value);
      ++at;
    }
    brick.values = Leaf::Smallest(values);
  }
  return edit;
}

double NumberOf(std::string_view text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    throw DamagedBytes("damaged: a setting is no number");
  }
  return value;
}

// False if no setting has this name.
bool Set(HapticSettings& settings, std::string_view key, std::string_view value) {
  for (const NumberSetting& setting : kNumberSettings) {
    if (setting.key == key) return settings.*setting.member = NumberOf(value), true;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    if (setting.key != key) continue;
    if (value != "on" && value != "off") throw DamagedBytes("damaged: a setting is no flag");
    settings.*setting.member = value == "on";
    return true;
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    if (setting.key != key) continue;
    const std::optional<int> number = palpate::NumberOf(setting, value);
    if (!number) throw DamagedBytes("damaged: a setting is none of its words");
    setting.set(settings, *number);
    return true;
  }
  return false;
}

// Lines "key=value".
void TakeSettings(std::string_view text, RecordedScene& scene) {
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    const std::string_view line = text.substr(0, end);
    const std::size_t equals = line.find('=');
    if (end == std::string_view::npos || equals == std::string_view::npos) {
      throw DamagedBytes("damaged: a setting is no line key=value");
    }
    const std::string_view key = line.substr(0, equals);
    if (!Set(scene.settings, key, line.substr(equals + 1))) {
      throw DamagedBytes("of a setting that this program does not know: a newer one wrote it");
    }
    text.remove_prefix(end + 1);
  }
  scene.settings.refinement = 1;  // there was no other
}

// Any byte: a bool may only be 0 or 1 in memory.
bool FlagOf(ByteReader& reader) { return reader.Get<std::uint8_t>() != 0; }

AffineMap MapOf(ByteReader& reader) {
  AffineMap map;
  for (double& number : map.linear.reshaped()) number = reader.Get<double>();
  for (double& number : map.translation) number = reader.Get<double>();
  return map;
}

SafetyLimits SafetyOf(ByteReader& reader) {
  SafetyLimits limits;
  for (double* number : {&limits.max_force_n, &limits.max_slew_n_per_s, &limits.ramp_in_s,
                         &limits.continuous_force_n, &limits.thermal_time_s,
                         &limits.max_speed_mm_per_s, &limits.max_missed_ticks}) {
    *number = reader.Get<double>();
  }
  limits.faults_stay = FlagOf(reader);
  limits.starts_on = FlagOf(reader);
  limits.stop_buttons = reader.Get<std::uint32_t>();
  return limits;
}

RecordedScene SceneOf(ByteReader& reader) {
  RecordedScene scene;
  for (std::uint64_t* number :
       {&scene.tick, &scene.scene_revision, &scene.settings_revision, &scene.volume_revision,
        &scene.loaded_revision, &scene.geometry_revision}) {
    *number = reader.Get<std::uint64_t>();
  }
  scene.isovalue = reader.Get<double>();
  scene.normalized_isovalue = reader.Get<double>();
  TakeSettings(reader.GetText(), scene);
  const std::optional<DecompositionMethod> method = Named<DecompositionMethod>(reader.GetText());
  if (!method) throw DamagedBytes("of a method that this program does not know");
  scene.settings.method = *method;
  scene.X_DI = MapOf(reader);
  scene.volume_hash.high = reader.Get<std::uint64_t>();
  scene.volume_hash.low = reader.Get<std::uint64_t>();
  scene.volume_source = reader.GetText();
  for (double& mm : scene.spacing_mm) mm = reader.Get<double>();
  scene.voxels_missing = FlagOf(reader);
  scene.tick_period_s = reader.Get<double>();
  scene.safety = SafetyOf(reader);
  scene.forces_off = FlagOf(reader);
  // Version 2 ends here. There, the name tells an upload; and passivity control took an Omni.
  scene.reloadable = !scene.volume_source.starts_with("upload:");
  if (reader.at_end()) return scene;
  scene.device.resolution_mm = reader.Get<double>();
  scene.device.max_force_n = reader.Get<double>();
  scene.device.tick_s = reader.Get<double>();
  scene.reloadable = FlagOf(reader);
  scene.all_voxels_stored = FlagOf(reader);
  for (int& voxels : scene.size) voxels = reader.Get<int>();
  scene.value_min = reader.Get<double>();
  scene.value_max = reader.Get<double>();
  if (reader.at_end()) return scene;  // version 3
  scene.is_level_set = FlagOf(reader);
  if (reader.at_end()) return scene;  // version 4
  scene.X_WI = MapOf(reader);
  return scene;
}

RecordedItem ItemOf(std::uint16_t type, ByteReader& reader) {
  if (type == kSamples) return SamplesOf(reader);
  if (type == kScene) return SceneOf(reader);
  if (type == kEdit) return EditOf(reader);
  const auto tick = reader.Get<std::uint64_t>();
  if (type == kKeyframe) return RecordedKeyframe{tick, reader.GetText()};
  if (type == kGap) return RecordedGap{tick, reader.Get<std::uint64_t>()};
  if (type != kMarker) throw DamagedBytes("of a kind that this program does not know");
  const auto time_ns = reader.Get<std::int64_t>();
  return RecordedEvent{tick, time_ns, reader.GetText(kMaxMarkerBytes)};
}

}  // namespace

OldRecording::OldRecording(std::unique_ptr<std::istream> stream, std::string name)
    : stream_(std::move(stream)), name_(std::move(name)) {
  std::string bytes = ReadUpTo(kHeaderStartBytes);
  if (!bytes.starts_with(kOldMagic) || bytes.size() < kHeaderStartBytes) {
    RefuseFile(name_, "is no recording of an earlier version: there is nothing to convert");
  }
  ByteReader start(std::string_view(bytes).substr(kOldMagic.size()));
  const auto version = start.Get<std::uint32_t>();
  const auto program_bytes = start.Get<std::uint32_t>();
  header_.created_unix_ns = start.Get<std::int64_t>();
  if (version < kOldestVersion || version > kNewestVersion || program_bytes > kMostProgramBytes) {
    RefuseFile(name_, "is of version " + std::to_string(version) + ", or damaged");
  }
  const bool has_clock = version >= kFirstClockVersion;
  const std::size_t rest_bytes = program_bytes + (has_clock ? 8 : 0) + kChecksumBytes;
  bytes += ReadUpTo(rest_bytes);
  if (bytes.size() != kHeaderStartBytes + rest_bytes) RefuseFile(name_, "ends within its header");
  ByteReader rest(std::string_view(bytes).substr(kHeaderStartBytes));
  header_.program = rest.GetBytes(program_bytes);
  if (has_clock) header_.created_monotonic_ns = rest.Get<std::int64_t>();
  if (rest.Get<std::uint64_t>() !=
      Checksum(std::string_view(bytes).substr(0, bytes.size() - kChecksumBytes))) {
    RefuseFile(name_, "has a damaged header");
  }
}

std::optional<RecordedItem> OldRecording::Next() {
  if (is_over_) return std::nullopt;
  try {
    const std::optional<Payload> payload = ReadChunk();
    if (payload && payload->type != kEnd) {
      ByteReader reader(payload->bytes);
      RecordedItem item = ItemOf(payload->type, reader);
      reader.ExpectEnd();
      CheckOrder(item);
      return item;
    }
    if (!payload) stopped_because_ = name_ + ": it was not closed";
  } catch (const DamagedBytes& damage) {
    stopped_because_ =
        name_ + ": chunk " + std::to_string(next_number_ - 1) + " is " + damage.what();
  }
  is_over_ = true;
  return std::nullopt;
}

// Markers stood at some tick nearby.
void OldRecording::CheckOrder(const RecordedItem& item) {
  std::uint64_t first = next_tick_, end = next_tick_;
  if (const auto* samples = std::get_if<RecordedSamples>(&item)) {
    first = samples->front().tick;
    end = samples->back().tick + 1;
  } else if (const auto* gap = std::get_if<RecordedGap>(&item)) {
    first = gap->first_tick;
    end = gap->last_tick + 1;
  } else if (const auto* scene = std::get_if<RecordedScene>(&item)) {
    first = end = scene->tick;
  } else if (const auto* edit = std::get_if<RecordedEdit>(&item)) {
    first = end = edit->tick;
  } else if (const auto* keyframe = std::get_if<RecordedKeyframe>(&item)) {
    first = end = keyframe->tick;
  }
  if (first < next_tick_ || end < first) throw DamagedBytes("damaged: its ticks go back");
  next_tick_ = end;
}

std::string OldRecording::ReadUpTo(std::size_t count) {
  std::string bytes(count, '\0');
  stream_->read(bytes.data(), static_cast<std::streamsize>(count));
  bytes.resize(static_cast<std::size_t>(stream_->gcount()));
  return bytes;
}

std::optional<OldRecording::Payload> OldRecording::ReadChunk() {
  std::string bytes = ReadUpTo(kChunkStartBytes);
  if (bytes.empty()) return std::nullopt;
  const std::uint64_t number = next_number_++;
  ByteReader start(bytes);
  const auto checksum = start.Get<std::uint64_t>();
  const auto stored_number = start.Get<std::uint64_t>();
  const auto type = start.Get<std::uint16_t>();
  start.Get<std::uint16_t>();
  const auto raw_bytes = start.Get<std::uint32_t>();
  const auto stored_bytes = start.Get<std::uint32_t>();
  if (raw_bytes > kMostPayloadBytes || stored_bytes > ZSTD_COMPRESSBOUND(kMostPayloadBytes)) {
    throw DamagedBytes("damaged: its length is beyond the limits");
  }
  const std::string packed = ReadUpTo(stored_bytes);
  bytes += packed;
  if (packed.size() < stored_bytes ||
      checksum != Checksum(std::string_view(bytes).substr(kChecksumBytes)) ||
      stored_number != number) {
    throw DamagedBytes("cut or damaged");
  }
  std::string raw(raw_bytes, '\0');
  if (ZSTD_decompress(raw.data(), raw.size(), packed.data(), packed.size()) != raw_bytes) {
    throw DamagedBytes("damaged: it does not unpack");
  }
  return Payload{type, std::move(raw)};
}

}  // namespace palpate::lab
