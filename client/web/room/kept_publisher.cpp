#include "client/web/room/kept_publisher.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "client/web/room/room_protocol.h"
#include "client/web/upstream/topic_text.h"
#include "client/web/volume/blob.h"
#include "client/web/wire/envelope.h"
#include "common/error/error.h"
#include "common/error/text.h"

namespace palpate::web {
namespace {

using Json = nlohmann::json;
using namespace std::chrono_literals;

constexpr auto kPatience = 5s;

[[noreturn]] void Fail(const std::string& why, ErrorKind kind = ErrorKind::kUnavailable) {
  throw Error(kind, why);
}

// Of an answer of the server; empty: none.
std::string ProblemIn(const Json& answer) {
  if (!answer.is_object()) return "the NATS server's answer makes no sense";
  if (!answer.contains("error")) return {};
  return "the NATS server keeps nothing: " +
         OneLine(answer["error"].value("description", std::string("unknown error")));
}

}  // namespace

KeptStream::KeptStream(NatsLink& link, const Subjects& subjects)
    : link_(link), subjects_(subjects), inbox_(link.NewInbox() + ".") {
  link_.Subscribe(inbox_ + "*", [this](const NatsMessage& message) { TakeAnswer(message); });
}

// The answer: JSON, and no error.
std::string KeptStream::Ask(const std::string& call, const std::string& json) {
  const std::string subject = "$JS.API.STREAM." + call + "." + subjects_.stream();
  auto answer = link_.Request(subject, json, kPatience);
  if (!answer) Fail("the NATS server has no JetStream, or does not answer");
  const std::string problem = ProblemIn(Json::parse(*answer, nullptr, false));
  if (!problem.empty()) Fail(problem);
  return std::move(*answer);
}

bool KeptStream::Ensure() {
  const Json stream = {{"name", subjects_.stream()},
                       {"subjects", {subjects_.kept_all()}},
                       {"storage", "memory"},
                       {"retention", "limits"},
                       {"discard", "old"},
                       {"max_msgs_per_subject", 1},
                       {"max_msgs", -1},
                       {"max_bytes", -1},
                       {"max_consumers", 1},
                       {"num_replicas", 1},
                       {"allow_direct", true}};
  const Json answer = Json::parse(Ask("CREATE", stream.dump()));
  const std::string created = answer.value("created", std::string());
  const std::uint64_t last = answer.value("/state/last_seq"_json_pointer, std::uint64_t{0});
  const std::lock_guard lock(mutex_);
  const std::uint64_t messages = answer.value("/state/messages"_json_pointer, std::uint64_t{0});
  const std::uint64_t most = last_sequence_ + published_ - acknowledged_;
  if (published_ != acknowledged_) kept_.clear();  // some were refused
  // Somebody may have purged the stream, or deleted messages.
  const bool lacks_messages = published_ == acknowledged_ && messages < kept_.size();
  const bool is_known = created == created_ && !is_shared_ && !lacks_messages &&
                        last >= last_sequence_ && last <= most;
  if (!is_known) kept_.clear();
  created_ = created;
  last_sequence_ = last;
  is_shared_ = false;
  ++run_;
  published_ = acknowledged_ = 0;
  problem_.clear();
  return is_known;
}

void KeptStream::Purge(const std::string& subjects) {
  Ask("PURGE", Json{{"filter", subjects}}.dump());
  const std::string_view below = std::string_view(subjects).substr(0, subjects.find_first_of("*>"));
  std::erase_if(kept_, [&](const std::string& subject) { return subject.starts_with(below); });
}

std::uint64_t KeptStream::Publish(const std::string& subject, std::string_view bytes) {
  WaitUntilFewerThan(kMostUnderWay);
  std::string reply = inbox_;
  std::uint64_t number = 0;
  {
    const std::lock_guard lock(mutex_);
    number = ++published_;
    reply += std::to_string(run_);
  }
  if (!link_.Publish(subject, bytes, reply)) {
    Fail(!link_.is_connected() ? "NATS is not reached"
                               : "the NATS server's max_payload is less than the " +
                                     std::to_string(bytes.size()) + " bytes of a message");
  }
  kept_.insert(subject);
  return number;
}

std::uint64_t KeptStream::acknowledged() {
  const std::lock_guard lock(mutex_);
  return acknowledged_;
}

void KeptStream::Wait(const std::function<void()>& meanwhile) { WaitUntilFewerThan(1, meanwhile); }

// Patience is for the next answer, not for all of them.
void KeptStream::WaitUntilFewerThan(std::uint64_t count, const std::function<void()>& meanwhile) {
  std::unique_lock lock(mutex_);
  auto end = std::chrono::steady_clock::now() + kPatience;
  std::uint64_t before = acknowledged_;
  while (problem_.empty() && published_ - acknowledged_ >= count) {
    if (wake_.wait_for(lock, 100ms) == std::cv_status::timeout && meanwhile) {
      lock.unlock();
      meanwhile();
      lock.lock();
    }
    const auto now = std::chrono::steady_clock::now();
    if (acknowledged_ != before) end = now + kPatience;
    before = acknowledged_;
    if (!link_.is_connected()) Fail("NATS is not reached");
    if (now > end) Fail("the NATS server does not answer");
  }
  if (!problem_.empty()) Fail(problem_, kind_);
}

void KeptStream::TakeAnswer(const NatsMessage& message) {
  const Json answer = Json::parse(message.bytes, nullptr, false);
  const bool is_lost = message.status != 0;
  const std::string problem = is_lost ? "the NATS server has lost the room" : ProblemIn(answer);
  const std::lock_guard lock(mutex_);
  if (message.subject.substr(inbox_.size()) != std::to_string(run_)) return;
  if (problem.empty()) {
    const std::uint64_t sequence = answer.value("seq", std::uint64_t{0});
    if (sequence != last_sequence_ + 1) is_shared_ = true;
    last_sequence_ = sequence;
    if (problem_.empty()) ++acknowledged_;
  } else if (problem_.empty()) {
    problem_ = problem;
    kind_ = is_lost ? ErrorKind::kUnavailable : ErrorKind::kDiskFull;
  }
  wake_.notify_all();
}

namespace {

constexpr auto kBetweenVolumes = 50ms;
constexpr auto kBetweenLooks = 2s;
constexpr auto kAfterProblem = 400ms;  // a setting may wait
constexpr std::chrono::seconds kAfterFull = 2s;
constexpr std::chrono::seconds kLongestPause = 60s;
constexpr std::size_t kGroupsBetweenTexts = 64;
// Of a group: nobody's. Whether the stream has it is not known.
constexpr ContentHash kNotKnown{~std::uint64_t{0}, ~std::uint64_t{0}};

std::size_t At(Topic topic) { return static_cast<std::size_t>(topic); }

std::string TextIn(const Texts& texts, Topic topic) {
  return texts.at(At(topic)) ? *texts.at(At(topic)) : std::string();
}

}  // namespace

KeptPublisher::KeptPublisher(const NatsServer& server, const Subjects& subjects, FindBlob find_blob,
                             std::function<void(const std::string& why)> refused)
    : subjects_(subjects),
      find_blob_(std::move(find_blob)),
      link_(server, "palpate-web: volume of room " + subjects.room(),
            {.connected = [this] { Wake(is_connection_, true); },
             .lost = [this](const std::string& why) { SetProblem("NATS is not reached: " + why); },
             .missed = {},
             .refused = std::move(refused)}),
      stream_(link_, subjects_) {
  link_.Start();
  thread_ = std::thread([this] { Run(); });
}

KeptPublisher::~KeptPublisher() {
  Wake(stopping_, true);
  thread_.join();
  link_.End();
}

void KeptPublisher::Wake(bool& flag, bool value) {
  {
    const std::lock_guard lock(mutex_);
    flag = value;
  }
  wake_.notify_all();
}

void KeptPublisher::Put(Texts texts) {
  {
    const std::lock_guard lock(mutex_);
    texts_ = std::move(texts);
    is_new_ = true;
  }
  wake_.notify_all();
}

void KeptPublisher::SetWaits(bool waits) {
  Wake(is_connection_, true);
  Wake(waits_, waits);
}

std::string KeptPublisher::problem() const {
  const std::lock_guard lock(mutex_);
  return problem_;
}

std::map<std::string, std::string> KeptPublisher::kept() const {
  const std::lock_guard lock(mutex_);
  return put_;
}

void KeptPublisher::SetProblem(const std::string& problem) {
  const std::lock_guard lock(mutex_);
  problem_ = problem;
}

void KeptPublisher::Run() {
  while (WaitForWork()) {
    const Time began = std::chrono::steady_clock::now();
    std::chrono::milliseconds pause = kBetweenVolumes;
    try {
      if (Publish()) {
        SetProblem("");
        pause_ = 0s;
        retry_at_ = {};
      }
    } catch (const std::exception& error) {
      ForgetSent();
      Wake(is_connection_, true);
      const auto* const known = dynamic_cast<const Error*>(&error);
      if (known != nullptr && known->kind() == ErrorKind::kDiskFull) {
        is_purged_ = false;
        pause_ = std::clamp(2 * pause_, kAfterFull, kLongestPause);
        retry_at_ = std::chrono::steady_clock::now() + pause_;
      }
      if (link_.is_connected()) {
        SetProblem(error.what());
        pause = kAfterProblem;
      }
    }
    std::unique_lock lock(mutex_);
    wake_.wait_until(lock, began + pause, [this] { return stopping_; });
  }
}

bool KeptPublisher::WaitForWork() {
  std::unique_lock lock(mutex_);
  const auto is_work = [this] {
    return stopping_ || ((is_new_ || is_connection_) && !waits_ && link_.is_connected());
  };
  do {
    wake_.wait_until(lock, look_at_, is_work);
    const auto now = std::chrono::steady_clock::now();
    if (now < look_at_) continue;
    look_at_ = now + kBetweenLooks;
    is_connection_ = true;
  } while (!is_work());
  return !stopping_;
}

// Returns whether everything is kept.
bool KeptPublisher::Publish() {
  bool ensures = false;
  Texts texts;
  {
    const std::lock_guard lock(mutex_);
    ensures = std::exchange(is_connection_, false);
    is_new_ = false;
    texts = texts_;
  }
  if (ensures && !stream_.Ensure()) {
    ForgetSent();
    overview_ = {};
    is_purged_ = false;
    retry_at_ = {};
  }
  const bool is_volume = !TextIn(texts, Topic::kManifest).empty();
  if (is_volume && !is_purged_) {
    stream_.Purge(subjects_.volume());  // else newcomers ask for groups that are gone
    stream_.Purge(subjects_.group_all());
    groups_.clear();
    manifest_.clear();
    is_purged_ = true;
  }
  PublishTexts();
  const bool is_whole = !is_volume || PublishVolume(texts);
  WaitForAnswers();
  sent_.clear();
  return is_whole;
}

// Guests hear a text at once, whether or not the server answers.
void KeptPublisher::WaitForAnswers() {
  stream_.Wait([this] { PublishTexts(); });
}

bool KeptPublisher::PublishVolume(const Texts& texts) {
  const auto& manifest = texts.at(At(Topic::kManifest));
  if (std::exchange(tried_, manifest) == manifest && std::chrono::steady_clock::now() < retry_at_) {
    look_at_ = std::min(look_at_, retry_at_);
    return false;
  }
  if (!PublishBlobs(*manifest)) {
    Wake(is_new_, true);  // there is a newer manifest, or will be at once
    return false;
  }
  Put("volume", subjects_.volume(),
      RoomVolumeBytes(
          {TextIn(texts, Topic::kVolume), TextIn(texts, Topic::kPlacement), *manifest}));
  return true;
}

void KeptPublisher::PublishTexts() {
  Texts texts;
  {
    const std::lock_guard lock(mutex_);
    texts = texts_;
  }
  for (const Topic topic : kTextTopics) {
    const auto& text = texts.at(At(topic));
    if (!text) continue;
    const bool is_full = topic == Topic::kCopy && pause_ > 0s;
    Put(std::string(NameOf(topic)), subjects_.text(topic),
        is_full ? CopyText(0, "the room's server has no memory for it", false) : *text);
  }
}

void KeptPublisher::Put(const std::string& name, const std::string& subject,
                        const std::string& message) {
  const std::string hash = NameOf(KeptHash(subject, message));
  const auto found = put_.find(name);
  if (found != put_.end() && found->second == hash) return;
  stream_.Publish(subject, message);
  const std::lock_guard lock(mutex_);
  put_[name] = hash;
}

void KeptPublisher::TakeAcknowledged() {
  const std::uint64_t acknowledged = stream_.acknowledged();
  while (!sent_.empty() && sent_.front().number <= acknowledged) sent_.pop_front();
}

// After an error. Texts are few, so all of them are sent again.
void KeptPublisher::ForgetSent() {
  TakeAcknowledged();
  for (const Sent& one : sent_) groups_[one.group] = kNotKnown;
  sent_.clear();
  const std::lock_guard lock(mutex_);
  put_.clear();
}

// False: a blob is superseded and gone.
bool KeptPublisher::PublishBlobs(const std::string& manifest_text) {
  const std::string name = nlohmann::json::parse(manifest_text).at("name").get<std::string>();
  if (name == manifest_) return true;
  const BlobPtr blob = find_blob_(name);
  if (!blob) return false;
  const Manifest manifest = ParseManifest(*blob->Encoded(Encoding::kIdentity));
  manifest_.clear();
  if (!PublishGroups(manifest)) return false;
  if (std::exchange(overview_, {}) != manifest.overview &&
      !PublishBlob(manifest.overview, static_cast<std::uint8_t>(manifest.type),
                   [this](std::uint32_t part) { return subjects_.overview(part); })) {
    return false;
  }
  const auto subject = [this](std::uint32_t part) { return subjects_.manifest(part); };
  if (!PublishBlob(*ParseName(name), kManifestKind, subject)) return false;
  WaitForAnswers();
  sent_.clear();
  groups_.resize(manifest.groups.size());
  overview_ = manifest.overview;
  manifest_ = name;
  return true;
}

bool KeptPublisher::PublishGroups(const Manifest& manifest) {
  groups_.resize(std::max(manifest.groups.size(), groups_.size()));
  for (std::size_t n = 0; n < groups_.size(); ++n) {
    if (n % kGroupsBetweenTexts == 0) {
      TakeAcknowledged();
      PublishTexts();
      const std::lock_guard lock(mutex_);
      if (stopping_ || waits_) return false;
    }
    const ContentHash hash = n < manifest.groups.size() ? manifest.groups[n] : ContentHash{};
    if (hash == groups_[n]) continue;
    groups_[n] = kNotKnown;
    const std::string subject = subjects_.group(static_cast<std::uint32_t>(n));
    const auto number = hash == ContentHash{}
                            ? std::optional(stream_.Publish(subject, BackgroundPart()))
                            : PublishBlob(hash, static_cast<std::uint8_t>(manifest.type),
                                          [&](std::uint32_t) { return subject; });
    if (!number) return false;
    groups_[n] = hash;
    sent_.push_back({.number = *number, .group = n});
  }
  return true;
}

std::optional<std::uint64_t> KeptPublisher::PublishBlob(
    const ContentHash& hash, std::uint8_t kind,
    const std::function<std::string(std::uint32_t part)>& subject) {
  const BlobPtr blob = find_blob_(NameOf(hash));
  if (!blob) return std::nullopt;
  std::uint64_t number = 0;
  std::uint32_t part = 0;
  for (const std::string& bytes : PartsOf(kind, hash, *blob->Encoded(Encoding::kZstd))) {
    number = stream_.Publish(subject(part++), bytes);
  }
  return number;
}

}  // namespace palpate::web
