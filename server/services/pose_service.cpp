#include "server/services/pose_service.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "server/pump/pose_of.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

constexpr double kTickRateHz = 1000.0;
constexpr double kDefaultRateHz = 60.0;
constexpr std::uint32_t kMaxBatch = 256;
constexpr std::uint32_t kMaxUnacknowledged = 64;
constexpr double kMostWaitingS = 5.0;
// Without acknowledgements, the transport's buffer would let a slow client fall further and further
// behind. Fewer messages limit this delay.
constexpr double kMaxPlainMessagesPerSecond = 100.0;

}  // namespace

PoseStreamOptions ParsePoseStreamOptions(const v1::StreamPosesStart& start) {
  const double rate_hz = start.rate_hz() == 0.0 ? kDefaultRateHz : start.rate_hz();
  if (!(rate_hz > 0.0 && rate_hz <= kTickRateHz)) {
    throw Error(ErrorKind::kInvalidArgument, "rate_hz must be above 0 and at most 1000");
  }
  if (start.batch() > kMaxBatch) {
    throw Error(ErrorKind::kInvalidArgument, "batch must be at most 256");
  }
  if (std::ranges::any_of(start.hands(), [](std::uint32_t hand) { return hand != 0; })) {
    throw Error(ErrorKind::kInvalidArgument, "the daemon has one hand, 0");
  }
  PoseStreamOptions options;
  options.ticks_per_sample =
      static_cast<std::uint64_t>(std::max(1.0, std::round(std::min(kTickRateHz / rate_hz, 1e9))));
  options.batch = std::max(1u, start.batch());
  if (start.has_max_unacknowledged()) {
    if (start.max_unacknowledged() < 1 || start.max_unacknowledged() > kMaxUnacknowledged) {
      throw Error(ErrorKind::kInvalidArgument, "max_unacknowledged must be from 1 to 64");
    }
    options.max_unacknowledged = start.max_unacknowledged();
    const auto most_waiting =
        static_cast<std::size_t>(kMostWaitingS * kTickRateHz) / options.ticks_per_sample;
    options.waiting = std::min<std::size_t>(start.waiting(), most_waiting);
  } else {
    const double samples_per_second = kTickRateHz / static_cast<double>(options.ticks_per_sample);
    const double least = std::ceil(samples_per_second / kMaxPlainMessagesPerSecond);
    options.batch = std::max(options.batch, static_cast<std::size_t>(least));
  }
  options.waiting = std::max(options.waiting, options.batch);
  return options;
}

int SamplesPerSecond(const PoseStreamOptions& options) {
  return static_cast<int>(std::ceil(kTickRateHz / static_cast<double>(options.ticks_per_sample)));
}

void PoseStream::Add(const TickSample& sample) {
  const std::uint64_t now = sample.tick + sample.missed_ticks;
  if (next_tick_ && now < *next_tick_) return;
  // Missed ticks do not shift the later samples.
  const std::uint64_t step = options_.ticks_per_sample;
  next_tick_ = next_tick_ ? *next_tick_ + step * ((now - *next_tick_) / step + 1) : now + step;
  waiting_.push_back(sample);
  if (waiting_.size() > options_.waiting) {
    waiting_.pop_front();
    ++dropped_;
  }
}

void PoseStream::Acknowledge(std::uint64_t message_number) {
  acknowledged_ = std::max(acknowledged_, std::min(message_number, sent_));
}

bool PoseStream::HasMessage() const {
  const bool open =
      !options_.max_unacknowledged || sent_ - acknowledged_ < *options_.max_unacknowledged;
  return open && waiting_.size() >= options_.batch;
}

v1::StreamPosesResponse PoseStream::TakeMessage(std::int64_t now_ns) {
  v1::StreamPosesResponse message;
  message.set_message_number(++sent_);
  message.set_dropped_samples(dropped_);
  message.set_sent_time_ns(now_ns);
  for (std::size_t n = 0; n < options_.batch; ++n) {
    *message.add_samples() = ToProto(PoseOf(waiting_.front()));
    waiting_.pop_front();
  }
  return message;
}

namespace {

class PoseReactor final
    : public grpc::ServerBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse>,
      public SampleSink,
      public std::enable_shared_from_this<PoseReactor> {
 public:
  // The stream keeps itself alive until OnDone.
  void Begin(Pump& pump, ServiceMetrics& metrics, Admission admission,
             std::shared_ptr<PoseReactor> self) {
    pump_ = &pump;
    metrics_ = &metrics;
    admission_.emplace(std::move(admission));
    self_ = std::move(self);
    StartRead(&request_);
  }

  void OnSample(const TickSample& sample) override {
    const std::lock_guard lock(mutex_);
    if (finished_ || !stream_) return;
    stream_->Add(sample);
    WriteIfPossible();
  }

  void OnReadDone(bool ok) override {
    request_.DiscardUnknownFields();  // megabytes of them would stay with the stream
    const grpc::Status asked = ok ? Ask() : grpc::Status::OK;
    const bool started = HandleRead(ok, asked);
    // Called without the lock: the pump locks its sinks first and this stream afterwards.
    if (started) pump_->Subscribe(weak_from_this(), Pump::Feed::kShown);
  }

  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    if (!ok) {
      FinishOnce(grpc::Status::CANCELLED);
      return;
    }
    WriteIfPossible();
  }

  void OnCancel() override {
    const std::lock_guard lock(mutex_);
    FinishOnce(grpc::Status::CANCELLED);
  }

  void OnDone() override {
    // This is the last callback, so it needs no lock.
    if (stream_) metrics_->PoseStreamEnded();
    // The pump may hold this stream a little longer than gRPC its context.
    admission_->Leave();
    const std::shared_ptr<PoseReactor> last = std::move(self_);
  }

 private:
  // A message not yet acknowledged, and the time of its newest sample.
  struct Sent {
    std::uint64_t number;
    std::int64_t newest_ns;
  };

  // Judges the request that begins the stream, and takes its samples from the budget of all
  // streams. Called without the lock: a refusal writes to the log, which blocks while nobody reads
  // it.
  grpc::Status Ask() {
    if (!request_.has_start()) return grpc::Status::OK;
    if (options_) return {grpc::StatusCode::INVALID_ARGUMENT, "`start` comes once"};
    try {
      options_ = ParsePoseStreamOptions(request_.start());
    } catch (const Error& error) {
      return ToStatus(error);
    }
    return admission_->TakeSamples(SamplesPerSecond(*options_));
  }

  // Returns true if this request started the stream. `asked`: the answer of Ask.
  bool HandleRead(bool ok, const grpc::Status& asked) {
    const std::lock_guard lock(mutex_);
    if (finished_) return false;
    if (!ok) {
      // The client has closed its side. A stream without acknowledgements continues. A stream with
      // them ends, because it would get no more credit.
      if (!stream_ || acknowledges_) FinishOnce(EndStatus());
      return false;
    }
    const bool was_started = stream_.has_value();
    const grpc::Status status = asked.ok() ? Take(request_) : asked;
    if (!status.ok()) {
      FinishOnce(status);
      return false;
    }
    WriteIfPossible();
    StartRead(&request_);
    return !was_started;
  }

  grpc::Status EndStatus() const {
    if (stream_) return grpc::Status::OK;
    return {grpc::StatusCode::INVALID_ARGUMENT, "the first request must be `start`"};
  }

  grpc::Status Take(const v1::StreamPosesRequest& request) {
    if (request.has_start()) {
      stream_.emplace(*options_);
      acknowledges_ = options_->max_unacknowledged.has_value();
      metrics_->PoseStreamBegan();
      return grpc::Status::OK;
    }
    if (!stream_) return EndStatus();
    if (!request.has_acknowledgement()) {
      return {grpc::StatusCode::INVALID_ARGUMENT, "a request after `start` must acknowledge"};
    }
    stream_->Acknowledge(request.acknowledgement().message_number());
    CountAcknowledged(request.acknowledgement().message_number());
    return grpc::Status::OK;
  }

  void CountAcknowledged(std::uint64_t message_number) {
    std::optional<std::int64_t> newest_ns;
    for (; !sent_.empty() && sent_.front().number <= message_number; sent_.pop_front()) {
      newest_ns = sent_.front().newest_ns;
    }
    if (newest_ns) metrics_->PosesAcknowledged(MonotonicNowNs() - *newest_ns);
  }

  void WriteIfPossible() {
    if (finished_ || writing_ || !stream_ || !stream_->HasMessage()) return;
    const std::int64_t now_ns = MonotonicNowNs();
    response_ = stream_->TakeMessage(now_ns);
    CountSent(now_ns);
    writing_ = true;
    StartWrite(&response_);
  }

  void CountSent(std::int64_t now_ns) {
    const std::int64_t newest_ns = response_.samples().rbegin()->time_ns();
    metrics_->PosesSent(now_ns - newest_ns, response_.dropped_samples() - dropped_samples_);
    dropped_samples_ = response_.dropped_samples();
    // The list is never longer than the window of unacknowledged messages.
    if (acknowledges_) sent_.push_back({response_.message_number(), newest_ns});
  }

  void FinishOnce(const grpc::Status& status) {
    if (finished_) return;
    finished_ = true;
    Finish(status);
  }

  Pump* pump_ = nullptr;
  ServiceMetrics* metrics_ = nullptr;
  std::optional<Admission> admission_;
  std::shared_ptr<PoseReactor> self_;
  v1::StreamPosesRequest request_;
  std::optional<PoseStreamOptions> options_;  // used only by reads, which come one at a time

  std::mutex mutex_;  // guards the members below
  std::optional<PoseStream> stream_;
  bool acknowledges_ = false;
  bool writing_ = false;
  bool finished_ = false;
  std::uint64_t dropped_samples_ = 0;  // total up to the last message
  std::deque<Sent> sent_;              // oldest first; used only with acknowledgements
  v1::StreamPosesResponse response_;
};

}  // namespace

grpc::ServerBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse>* PoseService::StreamPoses(
    grpc::CallbackServerContext* context) {
  Admission admission = access_.Admit(context, "/palpate.v1.PoseService/StreamPoses");
  if (!admission.ok()) {
    return new RefusedStream<v1::StreamPosesRequest, v1::StreamPosesResponse>(std::move(admission));
  }
  auto reactor = std::make_shared<PoseReactor>();
  PoseReactor* raw = reactor.get();
  raw->Begin(pump_, metrics_, std::move(admission), std::move(reactor));
  return raw;
}

}  // namespace palpate
