// A room as its publisher has it, made by the tables of the headers alone: states of a volume, and
// their messages.
#pragma once

#include <xxhash.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/web/room/room_copy.h"
#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"
#include "common/bricks/zstd_codec.h"
#include "palpate/v1/envelope.pb.h"

namespace palpate::web {

using nlohmann::json;
using Random = std::mt19937;
using Time = RoomCopy::Time;

inline constexpr std::size_t kGroupBytes = std::size_t{32} * 32 * 32;  // of uint8

inline std::string Zip(const std::string& bytes) {
  return CompressBytes(std::as_bytes(std::span(bytes)));
}

// The 16 bytes of a name, most significant first.
inline std::string HashBytes(unsigned char kind, const std::string& bytes) {
  const std::string all = std::string(1, static_cast<char>(kind)) + bytes;
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, XXH3_128bits(all.data(), all.size()));
  return {reinterpret_cast<const char*>(canonical.digest), 16};
}

inline std::string Hex(const std::string& bytes) {
  std::string hex;
  for (const char c : bytes) {
    char two[3];
    std::snprintf(two, sizeof two, "%02x", static_cast<unsigned char>(c));
    hex += two;
  }
  return hex;
}

// By the table of room_protocol.h, in as many parts as wanted.
inline std::vector<std::string> PlainParts(unsigned char kind, const std::string& hash,
                                           const std::string& zstd, std::size_t count) {
  std::vector<std::string> parts;
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t first = zstd.size() * n / count;
    std::string part{1, static_cast<char>(kind)};
    for (const std::size_t value : {n, count}) {
      part += static_cast<char>(value & 255);
      part += static_cast<char>(value >> 8);
    }
    parts.push_back(part + hash + zstd.substr(first, zstd.size() * (n + 1) / count - first));
  }
  return parts;
}

using Messages = std::vector<std::pair<std::string, std::string>>;

// One state of a volume, as a publisher has it.
struct PlainVolumeState {
  Vec3i size = Vec3i::Zero();
  std::map<std::uint32_t, std::string> groups;  // by number; absent: background
  std::string overview;
  std::uint64_t revision = 0;
  // Made of these.
  std::string manifest, name, message;

  std::uint32_t count() const {
    return static_cast<std::uint32_t>(((size + Vec3i::Constant(31)) / 32).prod());
  }

  void Make() {
    Manifest made{.size = size,
                  .type = LeafType::kUint8,
                  .value_max = 255.0,
                  .revision = {.daemon_id = 7, .volume_revision = revision},
                  .overview = HashOf(HashBytes(0, overview)),
                  .overview_size = Vec3i::Ones(),
                  .groups = std::vector<ContentHash>(count())};
    for (const auto& [number, bytes] : groups) made.groups[number] = HashOf(HashBytes(0, bytes));
    manifest = ToJson(made);
    name = Hex(HashBytes(255, manifest));
    v1::RoomVolume room;
    room.mutable_facts()->mutable_volume()->set_name(std::to_string(revision));
    room.mutable_facts()->mutable_placement()->set_settings_revision(revision);
    room.set_manifest(json{{"type", "manifest"}, {"name", name}}.dump());
    message = room.SerializeAsString();
  }
};

inline std::string RandomGroup(Random& random) {
  std::string bytes(kGroupBytes, static_cast<char>(random() % 256));
  for (int n = 0; n < 9; ++n) bytes[random() % bytes.size()] = static_cast<char>(random());
  return bytes;
}

inline PlainVolumeState Edited(PlainVolumeState state, Random& random) {
  if (random() % 12 == 0) {
    for (int& axis : state.size) axis = 1 + static_cast<int>(random() % 90);
    state.groups.clear();
  }
  for (std::uint32_t n = 0, edits = 1 + random() % 6; n < edits; ++n) {
    const std::uint32_t number = random() % state.count();
    if (random() % 4 == 0) {
      state.groups.erase(number);
    } else {
      state.groups[number] = RandomGroup(random);
    }
  }
  state.overview = RandomGroup(random);
  ++state.revision;
  state.Make();
  return state;
}

// What a publisher that knows what the room keeps sends for a new state.
inline Messages MessagesOf(const PlainVolumeState& state, const PlainVolumeState& before,
                           const Subjects& subjects, Random& random) {
  Messages messages;
  const std::uint32_t count = std::max(state.count(), before.count());
  for (std::uint32_t n = 0; n < count; ++n) {
    const auto is = state.groups.find(n), was = before.groups.find(n);
    if (is == state.groups.end()) {
      if (was != before.groups.end()) messages.emplace_back(subjects.group(n), BackgroundPart());
    } else if (was == before.groups.end() || was->second != is->second) {
      const std::string& bytes = is->second;
      messages.emplace_back(subjects.group(n),
                            PlainParts(0, HashBytes(0, bytes), Zip(bytes), 1)[0]);
    }
  }
  std::shuffle(messages.begin(), messages.end(), random);
  const auto add = [&](bool is_manifest, const std::string& bytes) {
    const unsigned char kind = is_manifest ? 255 : 0;
    const auto parts = PlainParts(kind, HashBytes(kind, bytes), Zip(bytes), 1 + random() % 4);
    for (std::uint32_t n = 0; n < parts.size(); ++n) {
      messages.emplace_back(is_manifest ? subjects.manifest(n) : subjects.overview(n), parts[n]);
    }
  };
  add(false, state.overview);
  add(true, state.manifest);
  messages.emplace_back(subjects.volume(), state.message);
  return messages;
}

}  // namespace palpate::web
