#include "client/web/nats/kept_publisher.h"

#include <algorithm>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "client/web/nats/beat.h"
#include "client/web/nats/part.h"
#include "client/web/volume/blob_name.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

using namespace std::chrono_literals;

constexpr auto kBetweenVolumes = 50ms;
constexpr auto kAfterProblem = 2s;
constexpr std::size_t kGroupsBetweenTexts = 64;

std::size_t At(Topic topic) { return static_cast<std::size_t>(topic); }

std::string TextIn(const Texts& texts, Topic topic) {
  return texts.at(At(topic)) ? *texts.at(At(topic)) : std::string();
}

}  // namespace

KeptPublisher::KeptPublisher(const NatsServer& server, const Subjects& subjects, FindBlob find_blob,
                             Calls calls)
    : subjects_(subjects),
      find_blob_(std::move(find_blob)),
      calls_(std::move(calls)),
      link_(server, "palpate-web: volume of room " + subjects.room(),
            {.connected = [this] { Wake(is_connection_, true); },
             .lost = {},
             .missed = {},
             .refused = [this](const std::string& why) { SetProblem("NATS refuses: " + why); }}),
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
  Wake(is_anew_, true);
  Wake(waits_, waits);
}

void KeptPublisher::PublishAnew() { Wake(is_anew_, true); }

std::string KeptPublisher::problem() const {
  const std::lock_guard lock(mutex_);
  return problem_;
}

void KeptPublisher::SetProblem(const std::string& problem) {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(problem_, problem) == problem) return;
  }
  calls_.problem_changed();
}

void KeptPublisher::Run() {
  while (WaitForWork()) {
    const auto began = std::chrono::steady_clock::now();
    auto pause = std::chrono::milliseconds(kBetweenVolumes);
    try {
      Publish();
      SetProblem("");
    } catch (const std::exception& error) {
      // What was kept of that is not known.
      PublishAnew();
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
  wake_.wait(lock, [this] {
    const bool is_work = is_new_ || is_connection_ || is_anew_;
    return stopping_ || (is_work && !waits_ && link_.is_connected());
  });
  return !stopping_;
}

void KeptPublisher::Publish() {
  bool ensures = false;
  bool forgets = false;
  {
    const std::lock_guard lock(mutex_);
    forgets = std::exchange(is_anew_, false);
    ensures = std::exchange(is_connection_, false) || forgets;
    is_new_ = false;
  }
  if ((ensures && !stream_.Ensure()) || forgets) given_ = {};
  PublishTexts();
  Texts texts;
  {
    const std::lock_guard lock(mutex_);
    texts = texts_;
  }
  if (!texts.at(At(Topic::kVolume))) return;
  const std::string manifest = TextIn(texts, Topic::kManifest);
  const std::string volume = nlohmann::ordered_json{
      {"volume", TextIn(texts, Topic::kVolume)},
      {"placement", TextIn(texts, Topic::kPlacement)},
      {"manifest", manifest}}.dump();
  if (volume != given_.volume) {
    if (!manifest.empty() && !PublishBlobs(manifest)) {
      Wake(is_new_, true);  // there is a newer manifest, or will be at once
      return;
    }
    stream_.Wait();
    Put(Topic::kVolume, subjects_.volume(), volume);
    given_.volume = volume;
  }
  stream_.Wait();
}

void KeptPublisher::PublishTexts() {
  Texts texts;
  {
    const std::lock_guard lock(mutex_);
    texts = texts_;
  }
  for (const Topic topic : kTextTopics) {
    const auto& text = texts.at(At(topic));
    auto& given = given_.texts.at(At(topic));
    if (!text || text == given) continue;
    Put(topic, subjects_.text(topic), *text);
    given = text;
  }
}

void KeptPublisher::Put(Topic topic, const std::string& subject, const std::string& message) {
  stream_.Publish(subject, message);
  put_.at(At(topic)) = KeptHash(subject, message);
  std::map<std::string, std::string> kept;
  for (std::size_t n = 0; n < put_.size(); ++n) {
    if (put_[n] != ContentHash{})
      kept[std::string(NameOf(static_cast<Topic>(n)))] = NameOf(put_[n]);
  }
  calls_.kept(std::move(kept));
}

// False: a blob is superseded and gone.
bool KeptPublisher::PublishBlobs(const std::string& manifest_text) {
  const std::string name = nlohmann::json::parse(manifest_text).at("name").get<std::string>();
  if (name == given_.manifest) return true;
  const BlobPtr blob = find_blob_(name);
  if (!blob) return false;
  const Manifest manifest = ParseManifest(*blob->Encoded(Encoding::kIdentity));
  if (!PublishGroups(manifest)) return false;
  if (manifest.overview != given_.overview) {
    const auto subject = [this](std::uint32_t part) { return subjects_.overview(part); };
    if (!PublishBlob(manifest.overview, static_cast<std::uint8_t>(manifest.type), subject)) {
      return false;
    }
    given_.overview = manifest.overview;
  }
  const auto subject = [this](std::uint32_t part) { return subjects_.manifest(part); };
  if (!PublishBlob(*ParseName(name), kManifestKind, subject)) return false;
  given_.manifest = name;
  return true;
}

bool KeptPublisher::PublishGroups(const Manifest& manifest) {
  const std::size_t count = std::max(manifest.groups.size(), given_.groups.size());
  given_.groups.resize(count);
  for (std::size_t n = 0; n < count; ++n) {
    if (n % kGroupsBetweenTexts == 0) {
      const std::lock_guard lock(mutex_);
      if (stopping_ || waits_) return false;
    }
    if (n % kGroupsBetweenTexts == 0) PublishTexts();
    const ContentHash hash = n < manifest.groups.size() ? manifest.groups[n] : ContentHash{};
    if (hash == given_.groups[n]) continue;
    const auto subject = [&](std::uint32_t) {
      return subjects_.group(static_cast<std::uint32_t>(n));
    };
    if (hash == ContentHash{}) {
      stream_.Publish(subject(0), BackgroundPart());
    } else if (!PublishBlob(hash, static_cast<std::uint8_t>(manifest.type), subject)) {
      return false;
    }
    given_.groups[n] = hash;
  }
  given_.groups.resize(manifest.groups.size());
  return true;
}

bool KeptPublisher::PublishBlob(const ContentHash& hash, std::uint8_t kind,
                                const std::function<std::string(std::uint32_t part)>& subject) {
  const BlobPtr blob = find_blob_(NameOf(hash));
  if (!blob) return false;
  std::uint32_t number = 0;
  for (const std::string& part : PartsOf(kind, hash, *blob->Encoded(Encoding::kZstd))) {
    stream_.Publish(subject(number++), part);
  }
  return true;
}

}  // namespace palpate::web
