#include "server/recording/chunk_codec.h"

#include <optional>
#include <utility>

#include "common/error/error.h"
#include "server/recording/bytes.h"
#include "server/recording/edit_codec.h"
#include "server/recording/sample_codec.h"
#include "server/recording/settings_text.h"

namespace palpate {
namespace {

// Writes the map column by column, the translation last.
void PutMap(const AffineMap& map, ByteWriter& writer) {
  for (const double number : map.linear.reshaped()) writer.Put(number);
  for (const double number : map.translation) writer.Put(number);
}

// Accepts any byte: a bool may only be 0 or 1 in memory.
bool GetFlag(ByteReader& reader) { return reader.Get<std::uint8_t>() != 0; }

AffineMap GetMap(ByteReader& reader) {
  AffineMap map;
  for (double& number : map.linear.reshaped()) number = reader.Get<double>();
  for (double& number : map.translation) number = reader.Get<double>();
  return map;
}

// With structured bindings, the code does not compile until a new limit is stored, too.
void PutSafety(const SafetyLimits& limits, ByteWriter& writer) {
  const auto& [max_force_n, max_slew, ramp_in_s, continuous_force_n, thermal_time_s, max_speed,
               max_missed_ticks, faults_stay, starts_on, stop_buttons] = limits;
  for (const double number : {max_force_n, max_slew, ramp_in_s, continuous_force_n, thermal_time_s,
                              max_speed, max_missed_ticks}) {
    writer.Put(number);
  }
  writer.Put(faults_stay);
  writer.Put(starts_on);
  writer.Put(stop_buttons);
}

SafetyLimits GetSafety(ByteReader& reader) {
  SafetyLimits limits;
  auto& [max_force_n, max_slew, ramp_in_s, continuous_force_n, thermal_time_s, max_speed,
         max_missed_ticks, faults_stay, starts_on, stop_buttons] = limits;
  for (double* number : {&max_force_n, &max_slew, &ramp_in_s, &continuous_force_n, &thermal_time_s,
                         &max_speed, &max_missed_ticks}) {
    *number = reader.Get<double>();
  }
  faults_stay = GetFlag(reader);
  starts_on = GetFlag(reader);
  stop_buttons = reader.Get<std::uint32_t>();
  return limits;
}

void PutDevice(const PassivityDevice& device, ByteWriter& writer) {
  const auto& [resolution_mm, max_force_n, tick_s] = device;
  for (const double number : {resolution_mm, max_force_n, tick_s}) writer.Put(number);
}

PassivityDevice GetDevice(ByteReader& reader) {
  PassivityDevice device;
  auto& [resolution_mm, max_force_n, tick_s] = device;
  for (double* number : {&resolution_mm, &max_force_n, &tick_s}) *number = reader.Get<double>();
  if (!IsDevice(device)) throw DamagedBytes("damaged: the values of its device are out of range");
  return device;
}

Payload Encode(const RecordedSamples& samples) {
  if (samples.empty() || samples.size() > kSamplesPerChunk) {
    throw Error(ErrorKind::kInvalidArgument, "a chunk of a recording holds 1 to 1000 samples");
  }
  return {ChunkType::kSamples, EncodeSamples(samples)};
}

Payload Encode(const RecordedScene& scene) {
  ByteWriter writer;
  writer.Put(scene.tick);
  writer.Put(scene.scene_revision);
  writer.Put(scene.settings_revision);
  writer.Put(scene.volume_revision);
  writer.Put(scene.loaded_revision);
  writer.Put(scene.geometry_revision);
  writer.Put(scene.isovalue);
  writer.Put(scene.normalized_isovalue);
  writer.PutText(SettingsText(scene.settings));
  writer.PutText(NameOf(scene.settings.method));
  PutMap(scene.X_DI, writer);
  writer.Put(scene.volume_hash.high);
  writer.Put(scene.volume_hash.low);
  writer.PutText(scene.volume_source);
  for (const double mm : scene.spacing_mm) writer.Put(mm);
  writer.Put(scene.voxels_missing);
  writer.Put(scene.tick_period_s);
  PutSafety(scene.safety, writer);
  writer.Put(scene.forces_off);
  PutDevice(scene.device, writer);
  writer.Put(scene.reloadable);
  writer.Put(scene.all_voxels_stored);
  for (const int voxels : scene.size) writer.Put(voxels);
  writer.Put(scene.value_min);
  writer.Put(scene.value_max);
  writer.Put(scene.is_level_set);
  if (scene.X_WI) PutMap(*scene.X_WI, writer);
  return {ChunkType::kScene, std::move(writer).Take()};
}

RecordedScene DecodeScene(ByteReader& reader) {
  RecordedScene scene;
  scene.tick = reader.Get<std::uint64_t>();
  scene.scene_revision = reader.Get<std::uint64_t>();
  scene.settings_revision = reader.Get<std::uint64_t>();
  scene.volume_revision = reader.Get<std::uint64_t>();
  scene.loaded_revision = reader.Get<std::uint64_t>();
  scene.geometry_revision = reader.Get<std::uint64_t>();
  scene.isovalue = reader.Get<double>();
  scene.normalized_isovalue = reader.Get<double>();
  scene.settings = SettingsFromText(reader.GetText(), scene.unknown_settings);
  const std::optional<DecompositionMethod> method = Named<DecompositionMethod>(reader.GetText());
  if (!method) throw DamagedBytes("of a method that this program does not know");
  scene.settings.method = *method;
  scene.X_DI = GetMap(reader);
  scene.volume_hash.high = reader.Get<std::uint64_t>();
  scene.volume_hash.low = reader.Get<std::uint64_t>();
  scene.volume_source = reader.GetText();
  for (double& mm : scene.spacing_mm) mm = reader.Get<double>();
  scene.voxels_missing = GetFlag(reader);
  scene.tick_period_s = reader.Get<double>();
  scene.safety = GetSafety(reader);
  scene.forces_off = GetFlag(reader);
  if (reader.at_end()) return scene;  // version 2 ends here
  scene.device = GetDevice(reader);
  scene.reloadable = GetFlag(reader);
  scene.all_voxels_stored = GetFlag(reader);
  for (int& voxels : scene.size) voxels = reader.Get<int>();
  scene.value_min = reader.Get<double>();
  scene.value_max = reader.Get<double>();
  if (reader.at_end()) return scene;  // version 3 ends here
  scene.is_level_set = GetFlag(reader);
  if (reader.at_end()) return scene;  // version 4 ends here
  scene.X_WI = GetMap(reader);
  return scene;
}

Payload Encode(const RecordedEdit& edit) { return {ChunkType::kEdit, EncodeEdit(edit)}; }

Payload Encode(const TimedMarker& marker) {
  ByteWriter writer;
  writer.Put(marker.tick);
  writer.Put(marker.time_ns);
  writer.PutText(marker.text);
  return {ChunkType::kMarker, std::move(writer).Take()};
}

TimedMarker DecodeMarker(ByteReader& reader) {
  TimedMarker marker;
  marker.tick = reader.Get<std::uint64_t>();
  marker.time_ns = reader.Get<std::int64_t>();
  marker.text = reader.GetText(kMaxMarkerBytes);
  return marker;
}

Payload Encode(const RecordedGap& gap) {
  ByteWriter writer;
  writer.Put(gap.first_tick);
  writer.Put(gap.last_tick);
  return {ChunkType::kGap, std::move(writer).Take()};
}

RecordedGap DecodeGap(ByteReader& reader) {
  RecordedGap gap;
  gap.first_tick = reader.Get<std::uint64_t>();
  gap.last_tick = reader.Get<std::uint64_t>();
  if (gap.last_tick < gap.first_tick) throw DamagedBytes("damaged: a gap ends before it begins");
  return gap;
}

Payload Encode(const RecordedKeyframe& keyframe) {
  ByteWriter writer;
  writer.Put(keyframe.tick);
  writer.PutText(keyframe.bytes);
  return {ChunkType::kKeyframe, std::move(writer).Take()};
}

RecordedKeyframe DecodeKeyframe(ByteReader& reader) {
  RecordedKeyframe keyframe;
  keyframe.tick = reader.Get<std::uint64_t>();
  keyframe.bytes = reader.GetText();
  return keyframe;
}

Payload Encode(const RecordedEnd& end) {
  ByteWriter writer;
  writer.Put(end.ticks);
  writer.Put(end.lost_ticks);
  return {ChunkType::kEnd, std::move(writer).Take()};
}

RecordedEnd DecodeEnd(ByteReader& reader) {
  RecordedEnd end;
  end.ticks = reader.Get<std::uint64_t>();
  end.lost_ticks = reader.Get<std::uint64_t>();
  return end;
}

RecordedChunk Decode(ChunkType type, ByteReader& reader) {
  switch (type) {
    case ChunkType::kSamples:
    case ChunkType::kEdit:
      break;  // these chunks have their own codecs
    case ChunkType::kScene:
      return DecodeScene(reader);
    case ChunkType::kMarker:
      return DecodeMarker(reader);
    case ChunkType::kGap:
      return DecodeGap(reader);
    case ChunkType::kKeyframe:
      return DecodeKeyframe(reader);
    case ChunkType::kEnd:
      return DecodeEnd(reader);
  }
  throw DamagedBytes("of a kind that this program does not know");
}

}  // namespace

Payload EncodeChunk(const RecordedChunk& chunk) {
  return std::visit([](const auto& held) { return Encode(held); }, chunk);
}

RecordedChunk DecodeChunk(const Payload& payload) {
  if (payload.type == ChunkType::kSamples) return DecodeSamples(payload.bytes);
  if (payload.type == ChunkType::kEdit) return DecodeEdit(payload.bytes);
  ByteReader reader(payload.bytes);
  RecordedChunk chunk = Decode(payload.type, reader);
  reader.ExpectEnd();
  return chunk;
}

}  // namespace palpate
