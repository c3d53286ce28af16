#include "server/services/facts_service.h"

#include <memory>
#include <mutex>
#include <utility>

#include "common/contract/activity.h"
#include "common/wire/values.h"
#include "server/door/activity.h"
#include "server/log/line_budget.h"
#include "server/realtime/tick_timer.h"
#include "server/recording/recorded_messages.h"
#include "server/services/recording_service.h"
#include "server/services/volume_messages.h"

namespace palpate {
namespace {

double SecondsSince(std::int64_t time_ns, std::int64_t now_ns) {
  return 1e-9 * static_cast<double>(now_ns - time_ns);
}

}  // namespace

v1::GetActivityResponse ToProto(const Activity& activity) {
  v1::GetActivityResponse out;
  const std::int64_t now_ns = MonotonicNowNs();
  for (const Activity::Caller& caller : activity.callers(now_ns)) {
    *out.add_callers() =
        ToProto(ConnectedCaller{.caller = {caller.identity.name, caller.identity.role},
                                .peer = PeerInWords(caller.address),
                                .connected_s = SecondsSince(caller.came_ns, now_ns),
                                .watches = caller.watches});
  }
  for (const Activity::Change& change : activity.changes()) {
    *out.add_changes() =
        ToProto(LastChange{change.what, change.by, SecondsSince(change.time_ns, now_ns)});
  }
  return out;
}

void MarkCaller(const Admission& you, v1::GetActivityResponse& activity) {
  const std::string peer = PeerInWords(AddressOf(you.peer()));
  for (v1::ConnectedCaller& caller : *activity.mutable_callers()) {
    caller.set_is_you(caller.peer() == peer && caller.caller().identity() == you.caller().name);
  }
}

Reply* ActivityService::GetActivity(CallContext* context, const v1::GetActivityRequest* request,
                                    v1::GetActivityResponse* response) {
  return calls_.Answer(context, "/palpate.v1.ActivityService/GetActivity", *request, *response,
                       [=, this](const Admission& you) {
                         *response = ToProto(calls_.access().activity());
                         MarkCaller(you, *response);
                       });
}

Reply* ActivityService::EndCaller(CallContext* context, const v1::EndCallerRequest* request,
                                  v1::EndCallerResponse* response) {
  return calls_.Answer(context, "/palpate.v1.ActivityService/EndCaller", *request, *response,
                       [=, this](const Admission&) {
                         response->set_ended_calls(static_cast<std::uint32_t>(
                             calls_.access().EndCaller(request->identity())));
                       });
}

namespace {

using std::chrono::milliseconds;

constexpr milliseconds kSoon{20};    // for what a hand waits for, such as a slider
constexpr milliseconds kLater{100};  // for what is larger, or changes with every brick

// Changes, besides those that Admission::Changed names.
constexpr std::string_view kScene = "scene";
constexpr std::string_view kAny = "any";

using Bidi = grpc::ServerBidiReactor<v1::FollowRequest, v1::FollowResponse>;

class Reactor final : public Bidi,
                      public FactFollower,
                      public std::enable_shared_from_this<Reactor> {
 public:
  Reactor(FactBoard& board, Admission admission)
      : board_(board), admission_(std::move(admission)) {}

  // The stream keeps itself alive until OnDone.
  void Begin(std::shared_ptr<Reactor> self) {
    self_ = std::move(self);
    StartRead(&request_);
  }

  void OnReadDone(bool ok) override {
    request_.DiscardUnknownFields();  // megabytes of them would stay with the stream
    const bool is_start = ok && request_.has_start() && !is_begun_;
    // Without the lock: the board may end this at once.
    if (is_start) board_.Add(weak_from_this());
    const std::lock_guard lock(mutex_);
    if (is_start) {
      is_begun_ = true;
    } else if (!ok) {
      // The client has closed its side: there will be no acknowledgements.
      return FinishOnce(is_begun_ ? grpc::Status::OK : MissingStart());
    } else if (!is_begun_ || !request_.has_acknowledgement()) {
      return FinishOnce(MissingStart());
    } else {
      acknowledged_ = request_.acknowledgement().message_number();
      WriteNewer();
    }
    if (!is_finished_) StartRead(&request_);
  }
  void OnFacts() override {
    const std::lock_guard lock(mutex_);
    WriteNewer();
  }
  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
    if (ok) {
      WriteNewer();
    } else {
      FinishOnce(grpc::Status::CANCELLED);
    }
  }
  void OnCancel() override {
    const std::lock_guard lock(mutex_);
    FinishOnce(grpc::Status::CANCELLED);
  }
  void End() override {
    const std::lock_guard lock(mutex_);
    FinishOnce({grpc::StatusCode::UNAVAILABLE, "palpated is ending"});
  }
  void OnDone() override {
    // The board may hold this a little longer than gRPC the call's context.
    admission_.Leave();
    const std::shared_ptr<Reactor> last = std::move(self_);
  }

 private:
  static grpc::Status MissingStart() {
    return {grpc::StatusCode::INVALID_ARGUMENT, "`start` comes first and once"};
  }

  void WriteNewer() {
    if (is_writing_ || is_finished_ || acknowledged_ != response_.message_number()) return;
    v1::Facts facts;
    if (!board_.Take(told_, facts)) return;
    if (response_.message_number() == 0) {
      *facts.mutable_caller() =
          ToProto(CallerDescription{admission_.caller().name, admission_.caller().role});
    }
    if (facts.has_activity()) MarkCaller(admission_, *facts.mutable_activity());
    *response_.mutable_facts() = std::move(facts);
    response_.set_message_number(response_.message_number() + 1);
    is_writing_ = true;
    StartWrite(&response_);
  }
  void FinishOnce(const grpc::Status& status) {
    if (!std::exchange(is_finished_, true)) Finish(status);
  }

  FactBoard& board_;
  Admission admission_;
  std::shared_ptr<Reactor> self_;
  v1::FollowRequest request_;
  bool is_begun_ = false;  // used only by reads, which come one at a time

  std::mutex mutex_;  // guards what follows, and the start of reads and writes
  bool is_writing_ = false;
  bool is_finished_ = false;
  std::uint64_t acknowledged_ = 0;
  FactBoard::Told told_{};
  v1::FollowResponse response_;  // that is being written, or was written last
};

void PutSettings(const Session& session, v1::Facts& facts) {
  const SettingsState state = session.shown().settings();
  *facts.mutable_settings()->mutable_settings() = ToProto(state.settings);
  facts.mutable_settings()->set_settings_revision(state.settings_revision);
  *facts.mutable_settings()->mutable_ball() = ToProto(session.shown().ball());
  facts.mutable_settings()->set_replayed(state.replayed);
  const VolumeState volume = session.volume();
  facts.mutable_settings()->set_not_kept(!volume.settings_problem.empty() ||
                                         !volume.place_problem.empty());
}

void PutPlacement(Session& session, v1::Facts& facts) {
  if (!session.first_load().is_done()) return;
  const VolumeState state = session.shown().volume();
  *facts.mutable_placement() =
      ToProto(VolumePlacement{state.X_DI, state.settings_revision, state.patient_axes,
                              state.patient_axes_answered(), state.replayed});
}

void PutVolume(Session& session, v1::Facts& facts) {
  if (session.first_load().is_done()) *facts.mutable_volume() = ToProto(session.shown().volume());
}

void PutSeries(Session& session, const SeriesPlayer& series, v1::Facts& facts) {
  if (!session.first_load().is_done()) return;
  facts.mutable_series()->set_frames(0);
  try {
    *facts.mutable_series() = ToProto(series.state());
  } catch (const Error&) {
    // No series is loaded.
  }
}

}  // namespace

FactsService::FactsService(Access& access, Session& session, const SeriesPlayer& series,
                           const RecordingControl& recording, const DeviceService& device)
    : access_(access),
      // While the first volume is loaded, settings change without a scene. During a replay, the
      // forces are off.
      board_({{[&](auto& facts) { PutSettings(session, facts); }, kSoon, {kScene, kAny}},
              {[&](auto& facts) { PutPlacement(session, facts); }, kSoon, {kScene}},
              {[&](auto& facts) { PutVolume(session, facts); }, kLater, {kScene, "saved"}},
              {[&](auto& facts) { PutSeries(session, series, facts); }, kLater, {kScene, "series"}},
              {[&](auto& facts) { *facts.mutable_recording() = ToProto(recording.status()); },
               kLater,
               {kScene, "recording"}},
              {[&](auto& facts) { *facts.mutable_hands() = ToProto(device.Hands()); },
               kLater,
               {"forces", "hand", "recording"}},
              {[&](auto& facts) { *facts.mutable_activity() = ToProto(access.activity()); },
               kLater,
               {kAny}}}),
      listening_(session, *this) {
  access.SetOnChange([this](std::string_view what) {
    board_.MayHaveChanged(what);
    board_.MayHaveChanged(kAny);
  });
}

void FactsService::OnScene(const Scene&, std::span<const BrickChange>) { SceneMayHaveChanged(); }

void FactsService::SceneMayHaveChanged() { board_.MayHaveChanged(kScene); }

Bidi* FactsService::Follow(CallContext* context) {
  Admission admission = access_.Admit(context, "/palpate.v1.FactsService/Follow");
  if (!admission.ok()) {
    return new RefusedStream<v1::FollowRequest, v1::FollowResponse>(std::move(admission));
  }
  auto reactor = std::make_shared<Reactor>(board_, std::move(admission));
  Reactor* const raw = reactor.get();
  raw->Begin(std::move(reactor));
  return raw;
}

}  // namespace palpate
