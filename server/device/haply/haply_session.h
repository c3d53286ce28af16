// An arm of Haply's service, in a session of its own. haply_bus.h says what it does.
//
// Threads, errors: as StreamSession.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/device/haply/haply_bus.h"
#include "server/device/haply/inverse_link.h"

namespace palpate {

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

}  // namespace palpate
