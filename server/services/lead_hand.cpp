#include "server/services/lead_hand.h"

#include <grpcpp/alarm.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/log/log.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kLongestSilence{1000};
constexpr milliseconds kLook{2};  // while the servo does not follow the first target yet

class Lead final : public LeadHandReactor, public std::enable_shared_from_this<Lead> {
 public:
  Lead(const LeadHandParts& parts, Admission admission)
      : parts_(parts), admission_(std::move(admission)), who_(admission_.Who()) {}

  // The call keeps itself alive until OnDone and the last alarm.
  void Begin() {
    self_ = shared_from_this();
    const std::lock_guard lock(mutex_);
    SetAlarm();
    StartRead(&request_);
  }

  void OnReadDone(bool ok) override {
    bool has_taken = false;
    std::optional<Error> problem;
    {
      const std::lock_guard lock(mutex_);
      if (finished_) return;
      if (!ok) return FinishOnce(grpc::Status::OK, "");  // the client has closed its side
      try {
        has_taken = Move();
        StartRead(&request_);
      } catch (const Error& error) {
        problem = error;
      }
    }
    // Without the lock: the log blocks while nobody reads it.
    if (has_taken) NoteTaken();
    if (problem) End(admission_.Failed(*problem));
  }

  void OnCancel() override { End(grpc::Status::CANCELLED); }

  void OnDone() override {
    admission_.Leave();
    const std::shared_ptr<Lead> last = std::move(self_);
  }

 private:
  // Takes the target of the request. Returns true if the hand was taken with it.
  bool Move() {
    const v1::Vector3& target = request_.target_mm();
    if (request_.hand() != 0) Refuse("the daemon has one hand, 0");
    if (!request_.has_target_mm()) Refuse("a request that leads the hand needs target_mm");
    const Vec3 p_DTarget_mm(target.x(), target.y(), target.z());
    if (!p_DTarget_mm.allFinite()) Refuse("target_mm needs three finite numbers");
    std::optional<Eigen::Quaterniond> turned;
    if (request_.has_orientation()) {
      const v1::Quaternion& q = request_.orientation();
      turned.emplace(q.w(), q.x(), q.y(), q.z());
    }
    const bool takes = lead_ == 0;
    if (takes) lead_ = parts_.hand.Take(who_);
    parts_.hand.MoveTo(lead_, p_DTarget_mm, request_.buttons() & parts_.buttons, turned);
    newest_target_ = Clock::now();
    if (takes) {
      // The present tick may have read the target before this one. The next tick certainly knows
      // it.
      first_tick_ = parts_.servo.FirstTickThatKnows();
      alarm_->Cancel();  // looks at once
    }
    return takes;
  }

  // Runs on gRPC's own threads, and holds none of them while it waits.
  void Look() {
    {
      const std::lock_guard lock(mutex_);
      if (!finished_ && Clock::now() >= newest_target_ + kLongestSilence) {
        FinishOnce({grpc::StatusCode::DEADLINE_EXCEEDED, "no target of the hand came for 1 s"},
                   ", as no target came for 1 s");
      }
      if (!finished_) {
        AnswerOnce();
        SetAlarm();
        return;
      }
      alarm_.reset();  // it holds this object
    }
    if (is_logged_) LogInfo("hand: given back by {}{}", who_, why_);
  }

  // A new alarm each time, because this may be the callback of the last one.
  void SetAlarm() {
    const bool awaits_tick = lead_ != 0 && !answered_;
    const auto silence =
        std::chrono::ceil<milliseconds>(newest_target_ + kLongestSilence - Clock::now());
    const milliseconds wait = awaits_tick ? kLook : std::max(silence, milliseconds(1));
    alarm_ = std::make_unique<grpc::Alarm>();
    alarm_->Set(gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC),
                             gpr_time_from_millis(wait.count(), GPR_TIMESPAN)),
                [self = shared_from_this()](bool) { self->Look(); });
  }

  void AnswerOnce() {
    if (answered_ || lead_ == 0) return;
    const std::optional<ForceTick> newest = parts_.forces.newest();
    if (!newest || newest->tick < first_tick_) return;
    answered_ = true;
    response_.set_applied_tick(first_tick_);
    StartWrite(&response_);
  }

  void NoteTaken() {
    admission_.Changed("hand");
    // Whoever takes the hand again and again must not fill the log.
    const bool is_logged =
        LogOfClient(LogLevel::kInfo, admission_.caller().name, "hand: led by {}", who_);
    const std::lock_guard lock(mutex_);
    is_logged_ = is_logged;
  }

  void End(const grpc::Status& status) {
    const std::lock_guard lock(mutex_);
    FinishOnce(status, "");
  }
  // The alarm then logs the end, without the lock.
  void FinishOnce(const grpc::Status& status, const char* why) {
    if (finished_) return;
    finished_ = true;
    why_ = why;
    if (lead_ != 0) {
      parts_.hand.GiveBack(lead_);
      admission_.MayHaveChanged("hand");
    }
    if (alarm_) alarm_->Cancel();
    admission_.Answered(status, 0);
    Finish(status);
  }

  const LeadHandParts parts_;
  Admission admission_;
  const std::string who_;
  std::shared_ptr<Lead> self_;
  v1::LeadHandRequest request_;

  std::mutex mutex_;  // guards the members below
  LedHand::Lead lead_ = 0;
  std::uint64_t first_tick_ = 0;
  Clock::time_point newest_target_ = Clock::now();
  bool answered_ = false;
  bool finished_ = false;
  bool is_logged_ = false;
  const char* why_ = "";
  v1::LeadHandResponse response_;
  std::unique_ptr<grpc::Alarm> alarm_;
};

}  // namespace

LeadHandReactor* LeadHandWith(const LeadHandParts& parts, Admission admission) {
  auto lead = std::make_shared<Lead>(parts, std::move(admission));
  Lead* raw = lead.get();
  raw->Begin();
  return raw;
}

}  // namespace palpate
