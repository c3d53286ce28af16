// Keeps the newest texts and the newest volume of the hub in the room's stream.
//
// The volume's message is published when all blobs that its manifest names are kept. Only blobs
// that changed are published. After a loss of the stream, or when somebody else wrote into it,
// everything is published anew.
//
// Threads: a thread of its own publishes, at most 20 times a second; methods on any, which never
// wait for NATS. `calls` are called on that thread and on those of the link.
// Errors: the constructor throws kInvalidArgument as Check does.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "client/web/hub/hub.h"
#include "client/web/nats/kept_stream.h"
#include "client/web/nats/nats_link.h"
#include "client/web/nats/subjects.h"
#include "client/web/volume/manifest.h"

namespace palpate::web {

// By topic; null: none yet.
using Texts = std::array<std::shared_ptr<const std::string>, kTopics>;

class KeptPublisher {
 public:
  using FindBlob = std::function<BlobPtr(std::string_view name)>;  // on any thread

  struct Calls {
    std::function<void()> problem_changed{};
    std::function<void(std::map<std::string, std::string> kept)> kept{};  // see Beat::kept
  };

  KeptPublisher(const NatsServer& server, const Subjects& subjects, FindBlob find_blob,
                Calls calls);
  ~KeptPublisher();
  KeptPublisher(const KeptPublisher&) = delete;
  KeptPublisher& operator=(const KeptPublisher&) = delete;

  void Put(Texts texts);
  // While another gateway publishes the room. Afterwards everything is published anew.
  void SetWaits(bool waits);
  void PublishAnew();

  bool is_connected() const { return link_.is_connected(); }
  // Why not everything is kept; empty: it is, or is under way.
  std::string problem() const;

 private:
  // What the stream has been given.
  struct Given {
    Texts texts{};
    std::string volume{};
    std::string manifest{};  // its name
    ContentHash overview{};
    std::vector<ContentHash> groups{};  // zero: background
  };
  void Run();
  bool WaitForWork();
  void Publish();
  void PublishTexts();
  void Put(Topic topic, const std::string& subject, const std::string& message);
  bool PublishBlobs(const std::string& manifest_text);
  bool PublishGroups(const Manifest& manifest);
  bool PublishBlob(const ContentHash& hash, std::uint8_t kind,
                   const std::function<std::string(std::uint32_t part)>& subject);
  void SetProblem(const std::string& problem);
  void Wake(bool& flag, bool value);

  const Subjects subjects_;
  const FindBlob find_blob_;
  const Calls calls_;
  NatsLink link_;
  KeptStream stream_;
  // The publishing thread's.
  Given given_;
  std::array<ContentHash, kTopics> put_{};  // hashes of texts and of the volume's message

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false, waits_ = false;
  bool is_new_ = false;         // texts_
  bool is_connection_ = false;  // a new one: the stream may be another one
  bool is_anew_ = false;        // forget what was given
  Texts texts_;
  std::string problem_;
  std::thread thread_;
};

}  // namespace palpate::web
