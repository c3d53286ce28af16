#include "client/sdk/hand_lead.h"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "client/sdk/link.h"
#include "common/wire/convert.h"
#include "palpate/v1/device.grpc.pb.h"

namespace palpate::client {
namespace {

constexpr std::chrono::milliseconds kLeastPause{4};
constexpr std::chrono::milliseconds kMostPause{50};

using Stream = grpc::ClientReaderWriter<v1::LeadHandRequest, v1::LeadHandResponse>;

}  // namespace

class HandLead::Parts {
 public:
  explicit Parts(Link& link) : link_(link), thread_([this] { Run(); }) {}
  ~Parts() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_all();
    context_.TryCancel();  // palpated takes the hand back, whatever is on its way
    thread_.join();
  }
  Parts(const Parts&) = delete;
  Parts& operator=(const Parts&) = delete;

  void MoveTo(const Vec3& p_DTarget_mm, std::uint32_t buttons,
              const std::optional<Eigen::Quaterniond>& R_DS) {
    {
      const std::lock_guard lock(mutex_);
      target_ = {p_DTarget_mm, buttons, R_DS};
      is_new_ = true;
    }
    changed_.notify_all();
  }
  HandLeadState state() const {
    const std::lock_guard lock(mutex_);
    return state_;
  }
  std::string problem() const {
    const std::lock_guard lock(mutex_);
    return problem_;
  }

 private:
  struct Target {
    Vec3 p_D_mm = Vec3::Zero();
    std::uint32_t buttons = 0;
    std::optional<Eigen::Quaterniond> R_DS;
  };

  void Run() {
    if (!AwaitFirstTarget()) return;
    try {
      Lead();
    } catch (const Error& error) {
      End(error.what());
    }
  }

  bool AwaitFirstTarget() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return stop_ || is_new_; });
    return !stop_;
  }

  void Lead() {
    const Link::Registered registered(link_, context_);
    const auto stub = v1::DeviceService::NewStub(link_.channel());
    const std::unique_ptr<Stream> stream = stub->LeadHand(&context_);
    std::thread reads([&] { Read(*stream); });
    while (const std::optional<Target> target = NextTarget()) {
      v1::LeadHandRequest request;
      request.mutable_target_mm()->set_x(target->p_D_mm.x());
      request.mutable_target_mm()->set_y(target->p_D_mm.y());
      request.mutable_target_mm()->set_z(target->p_D_mm.z());
      request.set_buttons(target->buttons);
      if (target->R_DS) *request.mutable_orientation() = ToProto(*target->R_DS);
      if (!stream->Write(request)) break;
    }
    reads.join();
    const grpc::Status status = stream->Finish();
    if (!stops()) throw ErrorOf(status);
  }

  // Until the call ends.
  void Read(Stream& stream) {
    v1::LeadHandResponse response;
    while (stream.Read(&response)) {
      const std::lock_guard lock(mutex_);
      state_ = HandLeadState::kLeading;
    }
    {
      const std::lock_guard lock(mutex_);
      has_ended_ = true;
    }
    changed_.notify_all();
  }

  // The newest target, when it is time to send it; none if the call ends.
  std::optional<Target> NextTarget() {
    std::unique_lock lock(mutex_);
    const auto ends = [this] { return stop_ || has_ended_; };
    changed_.wait_until(lock, sent_ + kLeastPause, ends);
    changed_.wait_until(lock, sent_ + kMostPause, [&] { return is_new_ || ends(); });
    if (ends()) return std::nullopt;
    is_new_ = false;
    sent_ = std::chrono::steady_clock::now();
    return target_;
  }

  Error ErrorOf(const grpc::Status& status) {
    // The daemon's own words: it waited for us, and not we for it.
    if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED) {
      return {ErrorKind::kUnavailable, status.error_message()};
    }
    return link_.ErrorOfEnd(status);
  }

  void End(const std::string& problem) {
    const std::lock_guard lock(mutex_);
    state_ = HandLeadState::kEnded;
    problem_ = problem;
  }

  bool stops() const {
    const std::lock_guard lock(mutex_);
    return stop_;
  }

  Link& link_;
  grpc::ClientContext context_;

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable changed_;
  Target target_;
  bool is_new_ = false;  // since it was sent last
  std::chrono::steady_clock::time_point sent_{};
  bool stop_ = false;
  bool has_ended_ = false;
  HandLeadState state_ = HandLeadState::kBeginning;
  std::string problem_;

  std::thread thread_;
};

HandLead::HandLead(Link& link) : parts_(std::make_unique<Parts>(link)) {}
HandLead::~HandLead() = default;

void HandLead::MoveTo(const Vec3& p_DTarget_mm, std::uint32_t buttons,
                      const std::optional<Eigen::Quaterniond>& R_DS) {
  parts_->MoveTo(p_DTarget_mm, buttons, R_DS);
}
HandLeadState HandLead::state() const { return parts_->state(); }
std::string HandLead::problem() const { return parts_->problem(); }

}  // namespace palpate::client
