#include <prometheus/counter.h>
#include <prometheus/exposer.h>
#include <prometheus/gauge.h>
#include <prometheus/registry.h>
#include <sys/resource.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/web/app/run.h"
#include "client/web/http/server.h"
#include "client/web/hub/hub.h"
#include "client/web/room/room_publisher.h"
#include "client/web/room/room_source.h"
#include "client/web/upstream/palpated_source.h"
#include "common/error/error.h"
#include "common/error/text.h"
#include "common/wire/address.h"

namespace palpate::web {
namespace {

// Counters, and gauges, which are shown once they are set. Some counters have a label, by which
// they are counted apart.
enum class Metric {
  kGuests,     // gauge
  kDropped,    // by reason
  kRefused,    // by kind
  kAnswers,    // by status
  kSentBytes,  // by to: http, stream
  kSkipped,
  kBlobs,
  kSteered,       // by result: accepted, refused
  kPoseAge,       // gauge
  kCopyComplete,  // gauge
  kNatsConnected  // gauge
};

// The metrics of palpate-web for Prometheus: HTTP, /metrics, loopback only.
//
// Threads: the network thread; two threads of its own answer requests.
// Errors: Error: kConflict if the port is in use.
class Metrics {
 public:
  // None: they are counted and not shown.
  explicit Metrics(const std::optional<HostPort>& listen);
  ~Metrics();

  void Count(Metric metric, std::string_view label = "", double by = 1.0);
  void Set(Metric gauge, double value);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

struct Known {
  std::string name, help, label;
  bool is_gauge = false;
};

// In the order of Metric.
const std::vector<Known>& AllKnown() {
  static const std::vector<Known> all = {
      {"guests", "Guests that watch now", "", true},
      {"guests_dropped_total", "Guests dropped, by reason", "reason"},
      {"refused_total", "Refused logins and requests, by kind", "kind"},
      {"answers_total", "HTTP answers, by status", "status"},
      {"sent_bytes_total", "Bytes of answers and of streams", "to"},
      {"poses_skipped_total", "Poses that a slow guest did not get", ""},
      {"blobs_served_total", "Groups of voxels, overviews and manifests served", ""},
      {"steered_total", "Changes of settings by guests", "result"},
      {"pose_age_seconds", "Age of the newest pose", "", true},
      {"copy_complete", "1 if the copy of the volume is complete", "", true},
      {"nats_connected", "1 if the NATS server is reached", "", true},
  };
  return all;
}

std::unique_ptr<prometheus::Exposer> Expose(HostPort address) {
  if (address.host == "localhost") address.host = "127.0.0.1";
  try {
    // The timeout frees the thread of a reader that hangs.
    return std::make_unique<prometheus::Exposer>(std::vector<std::string>{
        "listening_ports", address.ToString(), "num_threads", "2", "request_timeout_ms", "2000"});
  } catch (const std::exception&) {
    throw Error(ErrorKind::kConflict, "cannot show metrics on " + address.ToString() +
                                          ": the port is in use; give another port");
  }
}

struct Metrics::Parts {
  std::shared_ptr<prometheus::Registry> registry = std::make_shared<prometheus::Registry>();
  std::vector<prometheus::Family<prometheus::Counter>*> counters;  // null: a gauge
  std::vector<prometheus::Family<prometheus::Gauge>*> gauges;      // null: a counter
  std::unique_ptr<prometheus::Exposer> exposer;
};

Metrics::Metrics(const std::optional<HostPort>& listen) : parts_(std::make_unique<Parts>()) {
  for (const Known& known : AllKnown()) {
    const std::string name = "palpate_web_" + known.name;
    prometheus::Registry& registry = *parts_->registry;
    parts_->counters.push_back(nullptr);
    parts_->gauges.push_back(nullptr);
    if (known.is_gauge) {
      parts_->gauges.back() =
          &prometheus::BuildGauge().Name(name).Help(known.help).Register(registry);
    } else {
      auto& family = prometheus::BuildCounter().Name(name).Help(known.help).Register(registry);
      parts_->counters.back() = &family;
      if (known.label.empty()) family.Add({});
    }
  }
  if (!listen) return;
  parts_->exposer = Expose(*listen);
  parts_->exposer->RegisterCollectable(parts_->registry);
}

Metrics::~Metrics() = default;

void Metrics::Count(Metric metric, std::string_view label, double by) {
  const auto place = static_cast<std::size_t>(metric);
  const std::string& name = AllKnown().at(place).label;
  prometheus::Labels labels;
  if (!name.empty()) labels.emplace(name, label);
  parts_->counters.at(place)->Add(labels).Increment(by);
}

void Metrics::Set(Metric gauge, double value) {
  parts_->gauges.at(static_cast<std::size_t>(gauge))->Add({}).Set(value);
}

// Under systemd with the line's priority, as sd-daemon(3) has it.
void Log(const std::string& line) {
  static const bool is_journal = std::getenv("JOURNAL_STREAM") != nullptr;
  std::fprintf(stderr, "%s%s\n", is_journal ? SD_INFO : "palpate-web: ", OneLine(line).c_str());
}

HttpEvents Events(Metrics& metrics) {
  const auto count = [&metrics](Metric metric, const char* label, std::size_t bytes) {
    metrics.Count(metric, label, static_cast<double>(bytes));
  };
  return {.log = Log,
          .refused = [&metrics](std::string_view kind) { metrics.Count(Metric::kRefused, kind); },
          .answered =
              [&metrics, count](int status, std::size_t bytes) {
                metrics.Count(Metric::kAnswers, std::to_string(status));
                count(Metric::kSentBytes, "http", bytes);
              },
          .joined = {},
          .left =
              [&metrics](std::string_view kind) {
                if (!kind.empty()) metrics.Count(Metric::kDropped, kind);
              },
          .streamed = [count](std::size_t bytes) { count(Metric::kSentBytes, "stream", bytes); },
          .skipped = [&metrics] { metrics.Count(Metric::kSkipped); }};
}

std::function<void(bool is_accepted)> CountSteered(Metrics& metrics) {
  return [&metrics](bool is_accepted) {
    metrics.Count(Metric::kSteered, is_accepted ? "accepted" : "refused");
  };
}

PalpatedOptions OptionsOf(const Config& config, Metrics& metrics) {
  const auto may_steer = [](const auto& one) { return !one.may_steer.empty(); };
  return {.server = config.palpated,
          .with_groups = config.with_groups,
          .steers = std::any_of(config.users.begin(), config.users.end(), may_steer) ||
                    std::any_of(config.nats.options.sites.begin(), config.nats.options.sites.end(),
                                may_steer),
          .version = PALPATE_VERSION,
          .log = Log,
          .steered = CountSteered(metrics)};
}

// What guests' connections need of the source.
void Join(Hub& hub, Source& source, Metrics& metrics) {
  hub.find_blob = [&](std::string_view name) {
    BlobPtr blob = source.FindBlob(name);
    if (blob) metrics.Count(Metric::kBlobs);
    return blob;
  };
  hub.steer = [&](const SteerRequest& request, std::function<void(std::string)> done) {
    source.Steer(request, std::move(done));
  };
  hub.health = [&] { return source.Health(); };
  hub.hello = [&](const std::string& user, const std::vector<std::string>& may_steer) {
    return source.Hello(user, may_steer);
  };
}

// Where what guests see comes from, and, if a room is published, where else it goes.
class Ends {
 public:
  Ends(const Config& config, Hub& hub, Metrics& metrics, const Post& post)
      : room_(config.nats.options.room) {
    RoomOptions room = config.nats.options;
    room.server.url = config.nats.url();
    room.version = PALPATE_VERSION;
    room.log = Log;
    room.steered = CountSteered(metrics);
    if (config.nats.from.empty()) {
      source_ = std::make_unique<PalpatedSource>(OptionsOf(config, metrics), hub, post);
    } else {
      auto source = std::make_unique<RoomSource>(std::move(room), hub, post);
      is_connected_ = [&source = *source] { return source.is_connected(); };
      source_ = std::move(source);
    }
    Join(hub, *source_, metrics);
    if (!config.nats.publish.empty()) {
      publisher_ = std::make_unique<RoomPublisher>(std::move(room), hub, post);
      is_connected_ = [this] { return publisher_->is_connected(); };
    }
  }

  const Source& source() const { return *source_; }
  // Once a second.
  void Poll() {
    source_->Poll();
    if (publisher_) publisher_->Poll();
  }

  // Empty: no NATS server is used.
  const std::function<bool()>& is_nats_connected() const { return is_connected_; }

  // For people.
  std::string State() const {
    const std::string health = source_->Health();
    std::string state = health.empty() ? "palpated is connected" : health;
    if (!publisher_) return state;
    const std::string problem = publisher_->problem();
    return state + "; room " + room_ +
           (problem.empty() ? " is published" : " is not published: " + OneLine(problem));
  }

 private:
  const std::string room_;
  std::unique_ptr<Source> source_;
  std::unique_ptr<RoomPublisher> publisher_;
  std::function<bool()> is_connected_;
};

std::string LinkOf(const Config& config, std::uint16_t port, const std::string& room_key) {
  std::string url = config.http.public_url;
  if (url.empty()) {
    url = (config.http.certificate_file.empty() ? "http://localhost:" : "https://localhost:") +
          std::to_string(port);
  }
  while (url.ends_with('/')) url.pop_back();
  url += "/#room=";
  // A journal keeps what is printed, and more people may read it than the file.
  const bool hides_key = !config.room_key_file.empty() && isatty(STDOUT_FILENO) == 0;
  return hides_key ? url + " and the key in " + config.room_key_file.string() : url + room_key;
}

// Each guest is a file descriptor, and the usual soft limit is 1024.
void RaiseFileLimit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
}

// Once a second: metrics, systemd's watchdog and its line of status.
class Heartbeat {
 public:
  Heartbeat(boost::asio::io_context& io, const Hub& hub, Ends& ends, Metrics& metrics)
      : timer_(io), hub_(hub), ends_(ends), metrics_(metrics) {
    Beat();
  }

 private:
  void Beat() {
    ends_.Poll();
    const Source& source = ends_.source();
    metrics_.Set(Metric::kGuests, hub_.guests());
    metrics_.Set(Metric::kPoseAge,
                 source.pose_age_s().value_or(std::numeric_limits<double>::quiet_NaN()));
    metrics_.Set(Metric::kCopyComplete, source.is_copy_complete() ? 1.0 : 0.0);
    if (ends_.is_nats_connected()) {
      metrics_.Set(Metric::kNatsConnected, ends_.is_nats_connected()() ? 1.0 : 0.0);
    }
    sd_notifyf(0, "WATCHDOG=1\nSTATUS=%d guests; %s", hub_.guests(), ends_.State().c_str());
    timer_.expires_after(std::chrono::seconds(1));
    timer_.async_wait([this](const boost::system::error_code& error) {
      if (!error) Beat();
    });
  }

  boost::asio::steady_timer timer_;
  const Hub& hub_;
  Ends& ends_;
  Metrics& metrics_;
};

}  // namespace

void Serve(const Config& config) {
  RaiseFileLimit();
  boost::asio::io_context io(1);
  boost::asio::signal_set signals(io, SIGINT, SIGTERM);
  const std::string room_key =
      config.room_key_file.empty() ? NewSecret(128) : ReadRoomKey(config.room_key_file);
  Metrics metrics(config.metrics);
  Hub hub;
  Ends ends(config, hub, metrics,
            [&io](std::function<void()> function) { boost::asio::post(io, std::move(function)); });
  HttpServer server(io, hub, config.http, {.room_key = room_key, .users = config.users},
                    Events(metrics));
  const Heartbeat heartbeat(io, hub, ends, metrics);
  signals.async_wait([&](const boost::system::error_code& error, int) {
    if (error) return;
    server.Stop();
    io.stop();
  });
  std::printf("open %s\n", LinkOf(config, server.port(), room_key).c_str());
  std::fflush(stdout);
  sd_notify(0, "READY=1");
  io.run();
  sd_notify(0, "STOPPING=1");
  // Nothing is left to do in order. Destructors would wait for what is under way, such as a name
  // server that does not answer.
  std::fflush(nullptr);
  std::_Exit(0);
}

}  // namespace palpate::web
