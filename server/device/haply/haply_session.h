// An arm of Haply's service, in a session of its own. haply_bus.h says what it does.
//
// Threads, errors: as StreamSession.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>

#include "server/device/haply/haply_bus.h"
#include "server/device/haply/inverse_link.h"

namespace palpate {

class HaplySession final : public StreamSession {
 public:
  // Connects, and finds the arm. Borrows all.
  HaplySession(const HaplyOptions& options, std::atomic<const char*>& hint);

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
  // Waits for a reply.
  InverseReply Await(std::chrono::milliseconds longest, const std::atomic<bool>& stop);
  void Take(const InverseLink::Message& message, StreamReceived& received, DeviceState& state);
  void TakeGrip(const InverseReply& reply, StreamReceived& received, DeviceState& state);
  void TakeEvents(StreamReceived& received);
  const char* HintOf(const InverseArm& arm) const;
  void CheckFelt(const InverseArm& arm, StreamReceived& received);
  bool Send(const std::optional<Vec3>& force_n);

  const HaplyOptions& options_;
  std::atomic<const char*>& hint_;
  const std::atomic<bool> never_{false};
  InverseLink link_;
  std::string identity_;
  std::string arm_;     // its id
  InverseGrip grip_{};  // its id and family; "" as id: none
  std::optional<InverseWriter> writer_{};
  bool is_before_3_5_ = false;
  bool is_scaled_ = false;     // the service multiplies all forces
  bool is_configured_ = true;  // by the newest full state, what the session has set still holds
  bool is_calibrated_ = false;
  bool had_grip_ = false;

  int unanswered_ = 0;  // messages
  std::int64_t sent_ns_ = 0, due_ns_ = 0, full_state_ns_ = 0;
  Vec3 sent_n_ = Vec3::Zero();
  std::int64_t unfelt_since_ns_ = 0;  // 0: a commanded force is felt, or there is none
  std::int64_t unfelt_told_ns_ = 0;
};

}  // namespace palpate
