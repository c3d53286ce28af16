#include "client/web/room/subjects.h"

#include <algorithm>
#include <charconv>

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

}  // namespace palpate::web
