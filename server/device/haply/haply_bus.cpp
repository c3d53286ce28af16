#include "server/device/haply/haply_bus.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/device/haply/inverse_link.h"
#include "server/realtime/thread_setup.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

// The middle of the workspace: of the vendor's samples. A Minverse's is not published.
const Vec3 kCentre_m(0.019, -0.153, 0.151);

// The service's frame, in m, and M, in mm.
Vec3 InverseToM(const Vec3& p_m) {
  const Vec3 q_mm = 1000.0 * (p_m - kCentre_m);
  return {q_mm.x(), q_mm.z(), -q_mm.y()};
}

Vec3 InverseFromM(const Vec3& force_n) { return {force_n.x(), -force_n.z(), force_n.y()}; }

// The handle points along its y: that is the stylus's -z.
Eigen::Quaterniond InverseGripToM(const Eigen::Quaterniond& orientation) {
  Eigen::Matrix3d to_M;
  to_M << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  return Eigen::Quaterniond(
             Eigen::Matrix3d(to_M * orientation.toRotationMatrix() * to_M.transpose()))
      .normalized();
}

// An arm of Haply's service, in a session of its own. haply_bus.h says what it does.
//
// Threads, errors: as StreamSession.
class HaplySession final : public StreamSession {
 public:
  // Connects, and finds the arm. Borrows all.
  HaplySession(const HaplyOptions& options, std::atomic<const char*>& hint,
               const std::atomic<bool>& stop);

  void SetUp(const std::atomic<bool>& stop) override;
  std::string place() const override { return "Haply's service"; }
  std::string identity() const override { return identity_; }
  StreamReceived Wait(std::chrono::microseconds longest, DeviceState& state) override;
  bool TrySend(const DeviceCommand& command) override;
  std::uint64_t transfer_errors() const override { return 0; }
  bool LetGo() noexcept override;

 private:
  void Choose(const InverseReply& inventory);
  void ChooseGrip(const InverseReply& inventory);
  void CheckIsFree(const InverseArm& arm) const;
  void CheckType(const InverseArm& arm) const;
  void ReadSettings(const std::atomic<bool>& stop);
  bool IsConfigured(const InverseArm& arm) const;
  // Whether the full state is in the answer to who asked for it. Else answers are not those that
  // they seem to be.
  bool IsFullAsAsked(bool is_full);
  // Waits for a reply.
  InverseReply Await(std::chrono::milliseconds longest, const std::atomic<bool>& stop);
  void Take(const InverseLink::Message& message, StreamReceived& received, DeviceState& state);
  void TakeGrip(const InverseReply& reply, StreamReceived& received, DeviceState& state);
  void TakeEvents(StreamReceived& received);
  // Returns false for what is no answer to palpated.
  bool TryTake(const InverseReply& reply, StreamReceived& received, DeviceState& state);
  const char* HintOf(const InverseArm& arm) const;
  void CheckFelt(const InverseArm& arm, StreamReceived& received);
  bool Send(const std::optional<Vec3>& force_n);

  const HaplyOptions& options_;
  std::atomic<const char*>& hint_;
  InverseLink link_;
  std::string identity_;
  std::string arm_;     // its id
  InverseGrip grip_{};  // its id and family; "" as id: none
  std::optional<InverseWriter> writer_{};
  bool is_before_3_5_ = false;
  const char* scale_hint_ = "";  // why there is no force, by the service's factor on all forces
  bool is_configured_ = true;    // by the newest full state, what the session has set still holds
  bool is_calibrated_ = false;
  bool had_grip_ = false;

  int unanswered_ = 0;               // messages
  std::int64_t quiet_until_ns_ = 0;  // nothing is sent: it is not clear what is answered
  int answers_to_full_ = 0;          // until the one with the full state; 0: none is due
  int missing_full_ = 0;             // in a row
  std::string told_event_;
  std::int64_t told_event_ns_ = 0;
  std::vector<std::string> other_arms_;  // their ids
  std::int64_t sent_ns_ = 0, due_ns_ = 0, full_state_ns_ = 0;
  Vec3 sent_n_ = Vec3::Zero();
  std::int64_t unfelt_since_ns_ = 0;  // 0: a commanded force is felt, or there is none
  std::int64_t unfelt_told_ns_ = 0;
};

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr std::int64_t kMsNs = 1'000'000;
constexpr std::int64_t kPeriodNs = 1'000'000'000 / HaplyBus::kRateHz;
constexpr milliseconds kConnectTime{2000}, kEndTime{50};
constexpr std::int64_t kLateNs = 4 * kMsNs;
constexpr std::int64_t kLostNs = 100 * kMsNs;
constexpr std::int64_t kQuietNs = 2 * kMsNs;
constexpr std::int64_t kFullStateNs = 1000 * kMsNs;
constexpr double kFeltN = 0.2;
constexpr std::int64_t kUnfeltNs = 100 * kMsNs, kTellAgainNs = 10'000 * kMsNs;
constexpr int kLastZeros = 3;

constexpr const char* kScaled =
    "no forces: the service multiplies all forces by a factor: what is shown is not what is felt; "
    "set the force scale to 1 in Haply Hub, and start palpated again";
constexpr const char* kUnknownScale =
    "no forces: the service does not tell whether it multiplies all forces by a factor: start it "
    "again, then palpated";
constexpr const char* kForeign =
    "no forces: the session's basis, mount, scale or damping is not as palpated set it: another "
    "program (Haply Hub, a browser) has changed it; end that program, and start palpated again";

const char* HintOfFlag(const std::string& flag) {
  if (flag == "power_supply") return "no power: plug in the device's power supply";
  if (flag == "started") return "the service has not started the device: see Haply Hub";
  if (flag == "ready") return "the device is not ready: see Haply Hub";
  return "not calibrated: calibrate it, as Haply Hub shows";
}

void Warn(const std::string& text, StreamReceived& received) {
  received.warning += (received.warning.empty() ? "" : "; ") + text;
}

std::string NamesOf(const auto& devices) {
  std::string names;
  for (const auto& device : devices) names += (names.empty() ? "" : ", ") + device.id;
  return names;
}

HaplySession::HaplySession(const HaplyOptions& options, std::atomic<const char*>& hint,
                           const std::atomic<bool>& stop)
    : options_(options), hint_(hint), link_(options.port, kConnectTime, stop) {
  Choose(Await(kConnectTime, stop));
}

InverseReply HaplySession::Await(milliseconds longest, const std::atomic<bool>& stop) {
  const auto end = std::chrono::steady_clock::now() + longest;
  while (!stop && std::chrono::steady_clock::now() < end) {
    link_.Wait(milliseconds(20));
    const std::optional<InverseLink::Message> message = link_.TakeMessage();
    if (!message) continue;
    if (std::optional<InverseReply> reply = ParseInverse(message->text)) return *reply;
    throw BusError(BusFault::kCorrupt,
                   "what answers there is not Haply's service, or one that is not known");
  }
  throw BusError(BusFault::kTimeout, "Haply's service does not answer");
}

void HaplySession::Choose(const InverseReply& inventory) {
  const InverseArm* chosen = nullptr;
  const bool is_found =
      std::ranges::find(inventory.arms, options_.serial, &InverseArm::id) != inventory.arms.end();
  if (inventory.has_strange_arm && !is_found) {
    throw BusError(BusFault::kCorrupt, "what Haply's service tells of a device is not known");
  }
  for (const InverseArm& arm : inventory.arms) {
    if (options_.serial.empty() || arm.id == options_.serial) chosen = &arm;
    if (&arm != chosen) other_arms_.push_back(arm.id);
  }
  if (inventory.arms.empty()) {
    throw BusError(BusFault::kAbsent,
                   "Haply's service runs, and has no device: plug it in and switch it on");
  }
  if (chosen == nullptr) {
    throw BusError(BusFault::kAbsent, "not found with device_id " + options_.serial +
                                          ": the service has " + NamesOf(inventory.arms));
  }
  if (options_.serial.empty() && inventory.arms.size() > 1) {
    throw BusError(BusFault::kAmbiguous,
                   "the service has several devices: set [device] serial to one of " +
                       NamesOf(inventory.arms));
  }
  CheckType(*chosen);
  CheckIsFree(*chosen);
  ChooseGrip(inventory);
  arm_ = chosen->id;
  writer_.emplace(arm_, grip_);
  identity_ = options_.model + " " + arm_;
  if (chosen->config && !chosen->config->about.empty()) identity_ += ", " + chosen->config->about;
  identity_ += grip_.id.empty() ? ", no grip" : ", grip " + grip_.id;
}

// A service that does not tell the type is older than the other models.
void HaplySession::CheckType(const InverseArm& arm) const {
  const std::string told = arm.config ? arm.config->type : "";
  const std::string type = told.empty() ? "inverse3" : told;
  if (type == options_.model) return;
  throw BusError(
      BusFault::kUnsuitable,
      fmt::format("the device is an \"{0}\", and [device] haply_model is \"{1}\": set it "
                  "to \"{0}\", and start palpated again",
                  type, options_.model));
}

void HaplySession::ChooseGrip(const InverseReply& inventory) {
  const auto named = std::ranges::find(inventory.grips, options_.grip, &InverseGrip::id);
  if (named != inventory.grips.end()) {
    grip_ = *named;
  } else if (!options_.grip.empty()) {
    throw BusError(BusFault::kAbsent,
                   "not found: the grip " + options_.grip + ": the service has " +
                       (inventory.grips.empty() ? std::string("none") : NamesOf(inventory.grips)));
  } else if (inventory.grips.size() > 1) {
    throw BusError(BusFault::kAmbiguous,
                   "the service has several grips: set [device] haply_grip to one of " +
                       NamesOf(inventory.grips));
  } else if (!inventory.grips.empty()) {
    grip_ = inventory.grips.front();
  }
  had_grip_ = !grip_.id.empty();
}

void HaplySession::CheckIsFree(const InverseArm& arm) const {
  if (!arm.is_in_use && (arm.mode.empty() || arm.mode == "idle")) return;
  throw BusError(BusFault::kBusy, "another program uses the device: end it");
}

void HaplySession::SetUp(const std::atomic<bool>& stop) {
  const OrdinaryScheduling ordinary;
  ReadSettings(stop);
  if (!link_.ListenToEvents(options_.events_port, kConnectTime, stop)) identity_ += ", no events";
  link_.TrySend(InverseSetUp(arm_));
  // Its answer has the full state: what came before it is not asked for.
  const auto end = std::chrono::steady_clock::now() + kConnectTime;
  bool is_answered = false;
  while (!is_answered) {
    const InverseReply reply = Await(kConnectTime, stop);
    const auto arm = std::ranges::find(reply.arms, arm_, &InverseArm::id);
    const bool is_full = arm != reply.arms.end() && arm->config.has_value();
    is_answered = is_full || is_before_3_5_ || std::chrono::steady_clock::now() > end;
    is_configured_ = arm != reply.arms.end() && IsConfigured(*arm);
  }
  full_state_ns_ = MonotonicNowNs() + kFullStateNs;
}

// The words of forces depend on the version: a wrong guess would be ignored without a word.
void HaplySession::ReadSettings(const std::atomic<bool>& stop) {
  const InverseAnswer version = GetFromInverse(options_.port, "/version", kConnectTime, stop);
  const auto number = ParseInverseVersion(version.body);
  if (version.status != 404 && !(version.status == 200 && number)) {
    throw BusError(BusFault::kTimeout, "Haply's service does not tell its version");
  }
  is_before_3_5_ = !number || *number < std::array<int, 2>{3, 5};
  identity_ += number ? fmt::format(", service {}.{}", (*number)[0], (*number)[1])
                      : std::string(", service of unknown version");
  if (is_before_3_5_) identity_ += ", which does not tell its basis and mount";
  const InverseAnswer scale =
      GetFromInverse(options_.port, "/settings/devices/force_scale", kConnectTime, stop);
  const std::optional<double> factor = ParseInverseForceScale(scale.body);
  // That a service has no such setting, it says.
  if (scale.status == 404) {
    identity_ += ", force scale not told";
  } else if (scale.status != 200 || !factor) {
    scale_hint_ = kUnknownScale;
  } else if (!(std::abs(*factor - 1.0) < 1e-6)) {
    scale_hint_ = kScaled;
  }
}

bool HaplySession::IsConfigured(const InverseArm& arm) const {
  const bool is_told = arm.config && arm.config->tells_placing;
  return arm.foreign.empty() && (is_told || is_before_3_5_);
}

bool HaplySession::IsFullAsAsked(bool is_full) {
  constexpr int kMostMissing = 3;
  const bool is_due = answers_to_full_ > 0 && --answers_to_full_ == 0;
  if (is_before_3_5_) return true;
  if (is_due) missing_full_ = is_full ? 0 : missing_full_ + 1;
  if (missing_full_ >= kMostMissing) is_configured_ = false;
  return is_due == is_full;
}

StreamReceived HaplySession::Wait(microseconds longest, DeviceState& state) {
  StreamReceived received;
  if (unanswered_ == 0) {
    const std::int64_t until_ns = std::max(due_ns_, quiet_until_ns_);
    const std::int64_t left_ns = std::max<std::int64_t>(until_ns - MonotonicNowNs(), 0);
    longest = std::min(longest, microseconds((left_ns + 999) / 1000));
  }
  link_.Wait(longest);
  // Also if an answer comes at last: nobody knows what the service did with the last force.
  if (unanswered_ > 0 && MonotonicNowNs() - sent_ns_ > kLostNs) {
    throw BusError(BusFault::kTimeout, "no reading for 100 ms: Haply's service does not answer");
  }
  TakeEvents(received);
  while (const std::optional<InverseLink::Message> message = link_.TakeMessage()) {
    Take(*message, received, state);
  }
  return received;
}

// What nobody asked for, and what cannot be read, may be the answer to another message than it
// seems: nothing is sent until it is quiet.
void HaplySession::Take(const InverseLink::Message& message, StreamReceived& received,
                        DeviceState& state) {
  const std::optional<InverseReply> reply =
      unanswered_ > 0 ? ParseInverse(message.text) : std::nullopt;
  const bool is_answer = std::exchange(unanswered_, std::max(unanswered_ - 1, 0)) > 0;
  const auto has_config = [](const InverseArm& arm) { return arm.config.has_value(); };
  const bool is_full = reply && std::ranges::any_of(reply->arms, has_config);
  const bool is_right = is_answer && IsFullAsAsked(is_full) && reply;
  if (!is_right || !TryTake(*reply, received, state)) {
    ++received.corrupt_frames;
    quiet_until_ns_ = message.time_ns + kQuietNs;
    return;
  }
  received.time_ns = message.time_ns;
  received.has_reading = true;
  ++received.readings;
}

bool HaplySession::TryTake(const InverseReply& reply, StreamReceived& received,
                           DeviceState& state) {
  const auto arm = std::ranges::find(reply.arms, arm_, &InverseArm::id);
  if (arm == reply.arms.end()) {
    if (reply.has_strange_arm) return false;
    throw BusError(BusFault::kAbsent, "Haply's service has lost the device");
  }
  if (arm->config) is_configured_ = IsConfigured(*arm);
  const char* const hint = HintOf(*arm);
  hint_ = hint;
  is_calibrated_ = *hint == '\0';
  CheckFelt(*arm, received);
  TakeGrip(reply, received, state);
  state.p_MHip_mm = InverseToM(arm->cursor_m);
  state.docked = false;
  state.calibrated = is_calibrated_;
  return true;
}

const char* HaplySession::HintOf(const InverseArm& arm) const {
  if (!arm.missing.empty()) return HintOfFlag(arm.missing);
  return is_configured_ && arm.foreign.empty() ? scale_hint_ : kForeign;
}

void HaplySession::TakeGrip(const InverseReply& reply, StreamReceived& received,
                            DeviceState& state) {
  // One that was switched on after palpated connected.
  if (grip_.id.empty() && options_.grip.empty() && reply.grips.size() == 1) {
    grip_ = reply.grips.front();
    writer_.emplace(arm_, grip_);
  }
  const auto grip = std::ranges::find(reply.grips, grip_.id, &InverseGrip::id);
  const bool has_grip = grip != reply.grips.end() && grip->is_awake;
  state.R_MS = has_grip ? InverseGripToM(grip->orientation) : Eigen::Quaterniond::Identity();
  state.buttons = has_grip ? grip->buttons : 0;
  if (std::exchange(had_grip_, has_grip) && !has_grip) {
    Warn("its grip " + grip_.id + " sleeps or is gone: its turning and buttons are missing",
         received);
  }
}

// A service that takes a message and does not know its words says nothing.
void HaplySession::CheckFelt(const InverseArm& arm, StreamReceived& received) {
  const std::int64_t now_ns = MonotonicNowNs();
  const bool is_unfelt = arm.felt_n && arm.felt_n->isZero() && sent_n_.norm() >= kFeltN;
  if (!is_unfelt) {
    unfelt_since_ns_ = 0;
  } else if (unfelt_since_ns_ == 0) {
    unfelt_since_ns_ = now_ns;
  } else if (now_ns - unfelt_since_ns_ > kUnfeltNs && now_ns > unfelt_told_ns_) {
    unfelt_told_ns_ = now_ns + kTellAgainNs;
    Warn("the service ignores our forces: its version may want other words; tell us its version",
         received);
  }
}

void HaplySession::TakeEvents(StreamReceived& received) {
  while (const std::optional<std::string> text = link_.TakeEvent()) {
    const std::optional<InverseEvent> event = ParseInverseEvent(*text);
    // How events name a device is not written: what does not name another one is ours.
    if (!event || std::ranges::find(other_arms_, event->arm) != other_arms_.end()) continue;
    if (event->ends_force) {
      throw BusError(BusFault::kBroken, "the device ended its forces: " + event->text);
    }
    // A force that was commanded all the while comes back by a ramp.
    received.restarted = received.restarted || event->frees;
    // Some come again and again.
    const std::int64_t now_ns = MonotonicNowNs();
    if (event->text.empty() || (event->text == told_event_ && now_ns < told_event_ns_)) continue;
    told_event_ = event->text;
    told_event_ns_ = now_ns + kTellAgainNs;
    Warn(event->text, received);
  }
}

bool HaplySession::TrySend(const DeviceCommand& command) {
  const bool on = command.motors_on && is_calibrated_;
  const Vec3 force_n = on ? InverseFromM(command.wrench_M.force_n) : Vec3(Vec3::Zero());
  const std::int64_t now_ns = MonotonicNowNs();
  const bool ends_force = force_n.isZero() && !sent_n_.isZero();
  const bool is_late = unanswered_ == 1 && now_ns - sent_ns_ > kLateNs;
  // The end of a force waits for nothing but its turn.
  const bool is_due = now_ns >= (ends_force ? due_ns_ : std::max(due_ns_, quiet_until_ns_));
  const bool may_send = unanswered_ == 0 ? is_due : ends_force && is_late;
  if (!may_send) return false;
  // A zero ends a force; then nothing is commanded.
  return on || ends_force ? Send(force_n) : Send(std::nullopt);
}

bool HaplySession::Send(const std::optional<Vec3>& force_n) {
  const std::int64_t now_ns = MonotonicNowNs();
  const bool wants_full_state = now_ns >= full_state_ns_;
  const std::string_view text = writer_->Write(
      {.force_n = force_n, .wants_full_state = wants_full_state, .is_before_3_5 = is_before_3_5_});
  if (!link_.TrySend(text)) return false;
  ++unanswered_;
  if (wants_full_state) {
    full_state_ns_ = now_ns + kFullStateNs;
    answers_to_full_ = unanswered_;
  }
  sent_ns_ = now_ns;
  due_ns_ = std::max(due_ns_ + kPeriodNs, now_ns + kPeriodNs / 2);
  sent_n_ = force_n.value_or(Vec3::Zero());
  return true;
}

bool HaplySession::LetGo() noexcept {
  const OrdinaryScheduling ordinary;
  const bool has_pushed = !sent_n_.isZero();
  int zeros = 0;  // that were answered
  try {
    const std::int64_t end_ns = MonotonicNowNs() + kEndTime.count() * kMsNs;
    int others = unanswered_;  // answers that come before those to zeros
    bool is_under_way = false;
    while (has_pushed && zeros < kLastZeros && MonotonicNowNs() < end_ns) {
      if (!is_under_way) is_under_way = Send(Vec3(Vec3::Zero()));
      link_.Wait(milliseconds(1));
      while (link_.TakeMessage()) {
        if (others-- > 0) continue;
        zeros += is_under_way ? 1 : 0;
        is_under_way = false;
      }
    }
  } catch (const std::exception&) {
    // What the service does with its last force now, nobody knows.
  }
  link_.Close(kEndTime);
  return !has_pushed || zeros > 0;
}

}  // namespace

DeviceDescription HaplySpec(const std::string& model) {
  DeviceDescription spec;
  spec.kind = "haply";
  double reach_mm = 100.0;
  // Caution, until somebody has seen it. For a Minverse, no figures were found.
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  spec.max_stiffness_n_per_mm = 0.5;
  spec.position_resolution_mm = 0.01;
  if (model == "inverse3") {
    spec.model = "Haply Inverse3";
  } else if (model == "inverse3x") {
    spec.model = "Haply Inverse3x";
  } else if (model == "minverse") {
    spec.model = "Haply Minverse";
    reach_mm = 40.0;
    spec.max_force_n = 1.0;
    spec.continuous_force_n = 0.5;
    spec.max_stiffness_n_per_mm = 0.3;
    spec.position_resolution_mm = 0.05;
  } else {
    throw Error(ErrorKind::kInvalidArgument,
                fmt::format("a model must be inverse3, inverse3x or minverse, not \"{}\"", model));
  }
  spec.workspace_min_mm = Vec3::Constant(-reach_mm);
  spec.workspace_max_mm = Vec3::Constant(reach_mm);
  spec.button_count = 3;
  spec.senses_orientation = true;
  spec.verification_level = kHaplyVerification;
  return spec;
}

std::vector<InverseArm> FindInverseArms(std::uint16_t port) {
  constexpr std::chrono::milliseconds kLongest{500};
  const std::atomic<bool> never{false};
  InverseLink link(port, kLongest, never);
  const auto end = std::chrono::steady_clock::now() + kLongest;
  std::optional<InverseReply> inventory;
  while (!inventory && std::chrono::steady_clock::now() < end) {
    link.Wait(std::chrono::milliseconds(20));
    if (const auto message = link.TakeMessage()) inventory = ParseInverse(message->text);
  }
  link.Close(std::chrono::milliseconds(50));
  if (inventory) return inventory->arms;
  throw BusError(BusFault::kTimeout, "what answers there is not Haply's service");
}

HaplyBus::HaplyBus(HaplyOptions options)
    : options_(std::move(options)), spec_(HaplySpec(options_.model)) {}

std::unique_ptr<StreamSession> HaplyBus::Open(const std::atomic<bool>& stop) {
  const OrdinaryScheduling ordinary;
  return std::make_unique<HaplySession>(options_, hint_, stop);
}

}  // namespace palpate
