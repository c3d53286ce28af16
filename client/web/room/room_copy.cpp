#include "client/web/room/room_copy.h"

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/web/room/room_protocol.h"
#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"
#include "client/web/wire/envelope.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

using Json = nlohmann::json;

constexpr ContentHash kNone{};

// The JSON object of a topic's text; null: it is none.
Json ObjectOf(std::string_view text, Topic topic) {
  if (text.size() > RoomCopy::kMostTextBytes) return {};
  Json json = Json::parse(text, nullptr, false);
  const bool is_text = json.is_object() && json.contains("type") && json["type"] == NameOf(topic);
  return is_text ? json : Json();
}

// A topic's message as guests get it. Nothing: the bytes are no message of this topic.
std::optional<std::string> MessageOf(std::string_view bytes, Topic topic) {
  if (const auto fact = FactOf(topic)) {
    return bytes.size() > RoomCopy::kMostTextBytes ? std::nullopt : ForwardedFact(bytes, *fact);
  }
  return ObjectOf(bytes, topic).is_null() ? std::nullopt : std::optional(std::string(bytes));
}

BlobPtr BlobOf(const Part& part, std::string zstd) {
  return std::make_shared<Blob>(
      NameOf(part.hash),
      part.kind == kManifestKind ? "application/json" : "application/octet-stream",
      std::make_shared<const std::string>(std::move(zstd)));
}

}  // namespace

RoomCopy::RoomCopy(const std::string& room)
    : subjects_(room), texts_{{.kept = {.kind = Kept::Kind::kVolume}}} {
  for (const Topic topic : kTextTopics) texts_.push_back({.kept = {.topic = topic}});
}

RoomCopy::News RoomCopy::TakeLive(std::string_view subject, std::string_view bytes, Time now) {
  return Take(subject, bytes, true, now);
}

RoomCopy::News RoomCopy::TakeAnswer(std::string_view subject, std::string_view bytes, Time now) {
  if (under_way_ > 0) --under_way_;
  return Take(subject, bytes, false, now);
}

RoomCopy::News RoomCopy::Take(std::string_view subject, std::string_view bytes, bool is_live,
                              Time now) {
  News news;
  const auto kept = subjects_.ParseKept(subject);
  if (!kept) return news;
  switch (kept->kind) {
    case Kept::Kind::kText:
      if (!IsNewest(*kept, subject, bytes, is_live)) break;
      if (auto told = MessageOf(bytes, kept->topic)) {
        news.texts.emplace_back(kept->topic, *std::move(told));
      }
      break;
    case Kept::Kind::kVolume:
      if (IsNewest(*kept, subject, bytes, is_live)) TakeVolume(bytes, news);
      break;
    case Kept::Kind::kManifest:
      TakePart(manifest_, kept->number, bytes, is_live, now);
      break;
    case Kept::Kind::kOverview:
      TakePart(overview_, kept->number, bytes, is_live, now);
      break;
    case Kept::Kind::kGroup:
      TakeGroup(kept->number, bytes, is_live, now);
      break;
  }
  ShowNext(now, news);
  shelf_.Expire(now);
  return news;
}

// False: an answer that was not asked for, or is older than a live message.
bool RoomCopy::IsNewest(const Kept& kept, std::string_view subject, std::string_view bytes,
                        bool is_live) {
  Text& text = *std::find_if(texts_.begin(), texts_.end(),
                             [&](const Text& one) { return one.kept == kept; });
  if (!is_live && text.ask != Ask::kUnderWay) return false;
  text.ask = Ask::kDone;
  text.hash = bytes.empty() ? kNone : KeptHash(subject, bytes);
  return true;
}

std::optional<RoomCopy::Volume> RoomCopy::VolumeOf(std::string_view bytes) {
  if (bytes.size() > kMostTextBytes) return std::nullopt;
  auto parts = ParseRoomVolume(bytes);
  if (!parts) return std::nullopt;
  const Json manifest = ObjectOf(parts->manifest, Topic::kManifest);
  const bool is_named = manifest.contains("name") && manifest["name"].is_string();
  const auto name = is_named ? ParseName(manifest["name"].get<std::string>()) : std::nullopt;
  if (!name || *name == kNone) return std::nullopt;
  return Volume{.texts = *std::move(parts), .manifest = *name};
}

void RoomCopy::TakeVolume(std::string_view bytes, News& news) {
  auto volume = VolumeOf(bytes);
  if (!volume) return;
  if (volume->manifest == shown_name_) {
    next_.reset();
    news.shown = std::move(volume->texts);
    return;
  }
  if (!next_ || next_->manifest != volume->manifest) {
    std::erase_if(manifest_.asked, [](const auto& one) { return one.second == Ask::kDone; });
  }
  next_ = std::move(volume);
}

void RoomCopy::TakePart(Parted& parted, std::uint32_t number, std::string_view bytes, bool is_live,
                        Time now) {
  if (number >= kMostParts) return;
  const auto at = static_cast<std::uint16_t>(number);
  const auto asked = parted.asked.find(at);
  const bool is_asked = asked != parted.asked.end() && asked->second == Ask::kUnderWay;
  if (is_live || is_asked) parted.asked[at] = Ask::kDone;
  const auto part = DecodePart(bytes);
  const bool is_manifest = parted.kind == Kept::Kind::kManifest;
  if (!part || part->number != number || part->hash == kNone ||
      (part->kind == kManifestKind) != is_manifest) {
    return;
  }
  // Later parts of an older, longer blob stay in the stream.
  const bool is_newest = is_live || (is_asked && number == 0);
  if (part->hash == parted.held) {
    if (is_newest) parted.parts.Clear();
    return;
  }
  if (part->hash != parted.parts.hash()) {
    if (!is_newest) return;
    parted.asked = {{at, Ask::kDone}};
  }
  auto zstd = parted.parts.Take(*part);
  if (zstd) Hold(parted, *part, *std::move(zstd), now);
}

void RoomCopy::Hold(Parted& parted, const Part& part, std::string zstd, Time now) {
  try {
    const std::string bytes = VerifiedBytes(part.kind, part.hash, zstd, Blob::kMostBytes);
    const bool is_manifest = parted.kind == Kept::Kind::kManifest;
    if (is_manifest) newest_ = ParseManifest(bytes);
    const std::size_t size = zstd.size();
    shelf_.Use(part.hash, size, [&] { return BlobOf(part, std::move(zstd)); });
    Replace(parted.held, part.hash, now);
    if (!is_manifest) return;
    std::erase_if(overview_.asked, [](const auto& one) { return one.second == Ask::kDone; });
    Compare(now);
  } catch (const Error&) {  // parts of two publishers, or a false one: dropped
  }
}

void RoomCopy::TakeGroup(std::uint32_t number, std::string_view bytes, bool is_live, Time now) {
  if (number >= kMostGroups) return;
  if (!is_live && (number >= groups_.size() || groups_[number].ask != Ask::kUnderWay)) return;
  if (number >= groups_.size()) groups_.resize(number + 1);
  Group& group = groups_[number];
  group.ask = Ask::kDone;
  const auto part = DecodePart(bytes);
  if (!part || part->count != 1 || part->hash == group.held) return;
  if (part->hash != kNone && !UseGroup(*part)) return;
  missing_ -= IsMissing(number) ? 1 : 0;
  Replace(group.held, part->hash, now);
  missing_ += IsMissing(number) ? 1 : 0;
}

// Verifies the group unless the shelf has it. False: it is not what its name says.
bool RoomCopy::UseGroup(const Part& part) {
  if (part.kind == kManifestKind) return false;
  BlobPtr blob = shelf_.Find(NameOf(part.hash));
  if (!blob) {
    const std::size_t size = kGroupVoxels * VoxelBytes(LeafType{part.kind});
    try {
      if (VerifiedBytes(part.kind, part.hash, part.slice, size).size() != size) return false;
    } catch (const Error&) {
      return false;
    }
    blob = BlobOf(part, std::string(part.slice));
  }
  shelf_.Use(part.hash, part.slice.size(), [&] { return blob; });
  return true;
}

// `hash` is in use already.
void RoomCopy::Replace(ContentHash& held, const ContentHash& hash, Time now) {
  if (held != kNone) shelf_.Release(held, now);
  held = hash;
}

bool RoomCopy::IsMissing(std::uint32_t number) const {
  return number < newest_.groups.size() && newest_.groups[number] != kNone &&
         newest_.groups[number] != groups_[number].held;
}

// Finds what the newest manifest names and the copy lacks.
void RoomCopy::Compare(Time now) {
  groups_.resize(std::max(groups_.size(), newest_.groups.size()));
  missing_ = 0;
  to_ask_.clear();
  for (auto n = static_cast<std::uint32_t>(newest_.groups.size()); n-- > 0;) {
    if (!IsMissing(n)) continue;
    const ContentHash& wanted = newest_.groups[n];
    Group& group = groups_[n];
    if (shelf_.Find(NameOf(wanted))) {
      shelf_.Use(wanted, 0, nullptr);
      Replace(group.held, wanted, now);
      continue;
    }
    ++missing_;
    if (group.ask == Ask::kUnderWay) continue;
    group.ask = Ask::kNo;
    to_ask_.push_back(n);
  }
}

void RoomCopy::ShowNext(Time now, News& news) {
  if (!next_ || next_->manifest != manifest_.held || overview_.held != newest_.overview ||
      missing_ > 0) {
    return;
  }
  UseShown(now);
  news.shown = std::move(next_->texts);
  next_.reset();
}

// The newest manifest is the one that is shown.
void RoomCopy::UseShown(Time now) {
  const auto use = [&](const ContentHash& old, const ContentHash& hash) {
    if (old == hash) return;
    if (hash != kNone) shelf_.Use(hash, 0, nullptr);
    if (old != kNone) shelf_.Release(old, now);
  };
  use(shown_name_, manifest_.held);
  use(shown_.overview, newest_.overview);
  shown_.groups.resize(std::max(groups_.size(), shown_.groups.size()));
  for (std::size_t n = 0; n < shown_.groups.size(); ++n) {
    const ContentHash& hash = n < newest_.groups.size() ? newest_.groups[n] : kNone;
    use(shown_.groups[n], hash);
    // What is background now may have no message that says so.
    if (hash == kNone && n < groups_.size()) Replace(groups_[n].held, kNone, now);
  }
  groups_.resize(newest_.groups.size());
  shown_ = newest_;
  shown_name_ = manifest_.held;
}

std::vector<std::string> RoomCopy::Asks(std::size_t most) {
  std::vector<std::string> asks;
  most -= std::min(most, under_way_);
  for (Text& text : texts_) {
    if (asks.size() == most || text.ask != Ask::kNo) continue;
    text.ask = Ask::kUnderWay;
    asks.push_back(subjects_.SubjectOf(text.kept));
  }
  for (Parted* const parted : {&manifest_, &overview_}) {
    const ContentHash wanted = parted == &overview_ ? newest_.overview
                               : next_              ? next_->manifest
                                                    : kNone;
    for (const std::uint16_t number : PartsToAsk(*parted, wanted)) {
      if (asks.size() == most) break;
      parted->asked[number] = Ask::kUnderWay;
      asks.push_back(subjects_.SubjectOf({.kind = parted->kind, .number = number}));
    }
  }
  while (asks.size() < most && !to_ask_.empty()) {
    const std::uint32_t number = to_ask_.back();
    to_ask_.pop_back();
    if (!IsMissing(number) || groups_[number].ask != Ask::kNo) continue;
    groups_[number].ask = Ask::kUnderWay;
    asks.push_back(subjects_.group(number));
  }
  under_way_ += asks.size();
  return asks;
}

// `wanted`: zeros: any, if none is held.
std::vector<std::uint16_t> RoomCopy::PartsToAsk(const Parted& parted,
                                                const ContentHash& wanted) const {
  if (wanted == kNone ? parted.held != kNone : parted.held == wanted) return {};
  const ContentHash& begun = parted.parts.hash();
  const bool is_begun = begun != kNone && (wanted == kNone || begun == wanted);
  auto numbers = is_begun ? parted.parts.Missing() : std::vector<std::uint16_t>{0};
  std::erase_if(numbers, [&](std::uint16_t number) { return parted.asked.contains(number); });
  return numbers;
}

void RoomCopy::AskAnew(bool everything) {
  under_way_ = 0;
  for (Text& text : texts_) {
    const bool is_volume = text.kept.kind == Kept::Kind::kVolume;
    if (everything || is_volume || text.ask == Ask::kUnderWay) text.ask = Ask::kNo;
  }
  manifest_.asked.clear();
  overview_.asked.clear();
  for (Group& group : groups_) group.ask = Ask::kNo;
  to_ask_.clear();
  // Newer groups than those of the manifest that is shown belong to the next one.
  if (manifest_.held == shown_name_) return;
  for (auto n = static_cast<std::uint32_t>(newest_.groups.size()); n-- > 0;) {
    if (IsMissing(n)) to_ask_.push_back(n);
  }
}

bool RoomCopy::TakeBeat(const std::map<std::string, std::string>& kept, Time now) {
  constexpr std::chrono::seconds kLeast{1}, kMost{60};
  std::map<std::string, std::string> missed;
  std::vector<Text*> texts;
  for (Text& text : texts_) {
    const bool is_volume = text.kept.kind == Kept::Kind::kVolume;
    const auto named = kept.find(std::string(NameOf(is_volume ? Topic::kVolume : text.kept.topic)));
    if (named == kept.end() || named->second == NameOf(text.hash)) continue;
    missed.insert(*named);
    texts.push_back(&text);
  }
  if (missed != missed_) {
    missed_ = std::move(missed);
    patience_ = kLeast;
    return false;
  }
  if (missed.empty() || now - asked_anew_ < patience_) return false;
  asked_anew_ = now;
  patience_ = std::min(2 * patience_, kMost);
  for (Text* const text : texts) {
    if (text->ask != Ask::kUnderWay) text->ask = Ask::kNo;
  }
  return true;
}

bool RoomCopy::is_complete() const {
  return !next_ && std::all_of(texts_.begin(), texts_.end(),
                               [](const Text& text) { return text.ask == Ask::kDone; });
}

}  // namespace palpate::web
