// The call that leads the simulated hand: DeviceService.LeadHand.
//
// The hand is taken with the call's first target, and given back when the call ends: by its client,
// after a second without a target, or by a policy that no longer allows it.
//
// Threads: any; no thread waits. Ownership: a call owns itself until gRPC has finished with it.
#pragma once

#include <grpcpp/grpcpp.h>

#include "palpate/v1/device.grpc.pb.h"
#include "server/door/access.h"
#include "server/pump/tick_outbox.h"
#include "server/servo/servo_loop.h"
#include "server/simulated_hand/led_hand.h"

namespace palpate {

using LeadHandReactor = grpc::ServerBidiReactor<v1::LeadHandRequest, v1::LeadHandResponse>;

// All are borrowed, and outlive the server.
struct LeadHandParts {
  LedHand& hand;
  const ServoLoop& servo;
  const ForceWatch& forces;
  std::uint32_t buttons;  // those that the device has
};

// `admission`: of an admitted call.
LeadHandReactor* LeadHandWith(const LeadHandParts& parts, Admission admission);

}  // namespace palpate
