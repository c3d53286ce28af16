#include "client/web/room/room_protocol.h"

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <nlohmann/json.hpp>
#include <span>

#include "client/web/logins/secret.h"
#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"
#include "common/bricks/leaf_type.h"
#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

constexpr std::string_view kTopicNames[] = {"connection", "volume",   "placement", "copy",
                                            "manifest",   "settings", "steering",  "series",
                                            "recording",  "guests"};
static_assert(std::size(kTopicNames) == kTopics);

bool IsWord(std::string_view word, std::size_t most, bool may_be_large) {
  return !word.empty() && word.size() <= most && std::all_of(word.begin(), word.end(), [&](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-' ||
           (may_be_large && c >= 'A' && c <= 'Z');
  });
}

// Decimal, as std::to_string writes it.
std::optional<std::uint32_t> NumberOf(std::string_view digits) {
  std::uint32_t number = 0;
  const char* const end = digits.data() + digits.size();
  const auto [stop, error] = std::from_chars(digits.data(), end, number);
  if (error != std::errc() || stop != end || std::to_string(number) != digits) return std::nullopt;
  return number;
}

bool TakePrefix(std::string_view& text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

}  // namespace

bool IsRoom(std::string_view name) { return IsWord(name, 32, false); }

bool IsNatsUser(std::string_view name) { return IsWord(name, 64, true); }

std::string_view NameOf(Topic topic) { return kTopicNames[static_cast<std::size_t>(topic)]; }

Subjects::Subjects(const std::string& room)
    : room_(room), prefix_("palpate." + room + "."), kept_(prefix_ + "kept.") {
  if (!IsRoom(room)) Refuse("a room's name has 1 to 32 of a-z, 0-9, '_' and '-'");
}

std::string Subjects::SubjectOf(const Kept& kept) const {
  switch (kept.kind) {
    case Kept::Kind::kText:
      return text(kept.topic);
    case Kept::Kind::kVolume:
      return volume();
    case Kept::Kind::kManifest:
      return manifest(kept.number);
    case Kept::Kind::kOverview:
      return overview(kept.number);
    case Kept::Kind::kGroup:
      break;
  }
  return group(kept.number);
}

std::optional<Kept> Subjects::ParseKept(std::string_view subject) const {
  if (!TakePrefix(subject, kept_)) return std::nullopt;
  if (subject == "volume") return Kept{.kind = Kept::Kind::kVolume};
  if (TakePrefix(subject, "text.")) {
    for (const Topic topic : kTextTopics) {
      if (NameOf(topic) == subject) return Kept{.kind = Kept::Kind::kText, .topic = topic};
    }
    return std::nullopt;
  }
  const auto kind = TakePrefix(subject, "group.")      ? Kept::Kind::kGroup
                    : TakePrefix(subject, "manifest.") ? Kept::Kind::kManifest
                    : TakePrefix(subject, "overview.") ? Kept::Kind::kOverview
                                                       : Kept::Kind::kText;
  const auto number = NumberOf(subject);
  if (kind == Kept::Kind::kText || !number) return std::nullopt;
  return Kept{.kind = kind, .number = *number};
}

std::optional<std::string> Subjects::ParseSteer(std::string_view subject) const {
  if (!TakePrefix(subject, prefix_) || !TakePrefix(subject, "steer.") || !IsNatsUser(subject)) {
    return std::nullopt;
  }
  return std::string(subject);
}

std::string InboxPrefix(const std::string& user) { return "_INBOX_" + user; }

namespace {

constexpr std::uint64_t kMostProtocol = 1'000'000;

}  // namespace

std::string ToJson(const Beat& beat) {
  return nlohmann::ordered_json{{"protocol", beat.protocol},
                                {"session", beat.session},
                                {"machine", beat.machine},
                                {"kept", beat.kept}}
      .dump();
}

std::optional<Beat> ParseBeat(std::string_view json) {
  const auto read = nlohmann::json::parse(json, nullptr, false);
  try {
    const auto& protocol = read.at("protocol");
    if (!protocol.is_number_unsigned() || protocol.get<std::uint64_t>() > kMostProtocol) {
      return std::nullopt;
    }
    Beat beat{.protocol = protocol.get<int>()};
    beat.session = read.value("session", std::string());
    beat.machine = read.value("machine", std::string());
    if (beat.protocol == kRoomProtocol) beat.kept = read.value("kept", beat.kept);
    return beat;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

ContentHash KeptHash(std::string_view subject, std::string_view message) {
  const std::string bytes = std::string(subject) + '\0' + std::string(message);
  return HashOfBytes(std::byte{1}, std::as_bytes(std::span(bytes)));
}

std::string ThisMachine() {
  std::string boot;
  std::ifstream("/proc/sys/kernel/random/boot_id") >> boot;
  return ToHex(Sha256(boot)).substr(0, 32);
}

namespace {

constexpr char kVersion = 1;
constexpr std::size_t kHeaderBytes = 22;

bool IsKind(std::uint8_t kind) {
  return kind == kManifestKind || kind <= static_cast<std::uint8_t>(LeafType::kFloat);
}

void AppendU16(std::string& bytes, std::uint16_t value) {
  bytes += static_cast<char>(value & 0xff);
  bytes += static_cast<char>(value >> 8);
}

std::uint16_t U16At(std::string_view bytes, std::size_t at) {
  const auto low = static_cast<std::uint8_t>(bytes[at]);
  const auto high = static_cast<std::uint8_t>(bytes[at + 1]);
  return static_cast<std::uint16_t>(low | high << 8);
}

std::string EncodePart(const Part& part) {
  std::string bytes{kVersion, static_cast<char>(part.kind)};
  bytes.reserve(kHeaderBytes + part.slice.size());
  AppendU16(bytes, part.number);
  AppendU16(bytes, part.count);
  const auto hash = BytesOf(part.hash);
  bytes.append(hash.data(), hash.size());
  return bytes += part.slice;
}

}  // namespace

std::optional<Part> DecodePart(std::string_view bytes) {
  if (bytes.size() < kHeaderBytes || bytes.size() > kHeaderBytes + kMostSlice) return std::nullopt;
  const Part part{.kind = static_cast<std::uint8_t>(bytes[1]),
                  .number = U16At(bytes, 2),
                  .count = U16At(bytes, 4),
                  .hash = HashOf(bytes.substr(6, 16)),
                  .slice = bytes.substr(kHeaderBytes)};
  // Without a hash there are no bytes, and the reverse.
  const bool is_part = bytes[0] == kVersion && IsKind(part.kind) && part.number < part.count &&
                       part.count <= kMostParts &&
                       (part.hash == ContentHash{}) == part.slice.empty();
  return is_part ? std::optional(part) : std::nullopt;
}

std::vector<std::string> PartsOf(std::uint8_t kind, const ContentHash& hash,
                                 std::string_view zstd) {
  const std::size_t count = (zstd.size() + kMostSlice - 1) / kMostSlice;
  if (count > kMostParts) throw Error(ErrorKind::kTooLarge, "the volume is too large for a room");
  std::vector<std::string> parts;
  for (std::size_t n = 0; n < count; ++n) {
    parts.push_back(EncodePart({.kind = kind,
                                .number = static_cast<std::uint16_t>(n),
                                .count = static_cast<std::uint16_t>(count),
                                .hash = hash,
                                .slice = zstd.substr(n * kMostSlice, kMostSlice)}));
  }
  return parts;
}

std::string BackgroundPart() { return EncodePart({}); }

std::string VerifiedBytes(std::uint8_t kind, const ContentHash& hash, std::string_view zstd,
                          std::size_t most) {
  std::string bytes(CountValues(zstd, 1, most), '\0');
  if (zstd.size() > MostCompressedBytes(bytes.size()))
    Refuse("zstd bytes that hold something else");
  DecompressBytes(zstd, std::as_writable_bytes(std::span(bytes)));
  const ContentHash found =
      kind == kManifestKind ? HashOfManifest(bytes) : HashOfVoxels(LeafType{kind}, bytes);
  if (found != hash) Refuse("bytes of another hash than their name");
  return bytes;
}

std::optional<std::string> PartsAssembler::Take(const Part& part) {
  if (part.hash != hash_ || part.kind != kind_ || part.count != slices_.size()) {
    hash_ = part.hash;
    kind_ = part.kind;
    slices_.assign(part.count, {});
    missing_ = part.count;
  }
  std::string& slice = slices_.at(part.number);
  if (slice.empty()) --missing_;
  slice = part.slice;
  if (missing_ > 0) return std::nullopt;
  std::string whole;
  for (const std::string& one : slices_) whole += one;
  Clear();
  return whole;
}

void PartsAssembler::Clear() { *this = {}; }

std::vector<std::uint16_t> PartsAssembler::Missing() const {
  std::vector<std::uint16_t> missing;
  for (std::size_t n = 0; n < slices_.size(); ++n) {
    if (slices_[n].empty()) missing.push_back(static_cast<std::uint16_t>(n));
  }
  return missing;
}

}  // namespace palpate::web
