// Leads the simulated hand of a palpated, for people without a device.
//
//   auto hand = palpated.LeadHand();
//   hand->MoveTo({0.0, 12.0, -3.0});  // again and again, as the pointer moves
//
// The hand goes where the newest target is, as far as the surface lets it: in free space within a
// few hundredths of a second, in contact at target + felt force / 0.3 N/mm. Poses tell where it is.
//
// The first MoveTo takes the hand. A thread sends the newest target at once, up to 250 times per
// second, and again while it does not change: palpated gives the hand back to itself after a second
// without a target.
//
// Frame D, mm. Threads: any, also at the same time. Ownership: must not outlive the Calls that made
// it. The destructor gives the hand back, within a fraction of a second.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate::client {

class Link;

enum class HandLeadState {
  kBeginning,  // the hand does not follow yet
  kLeading,
  kEnded,  // for good; problem() says why
};

class HandLead {
 public:
  // See Calls::LeadHand.
  explicit HandLead(Link& link);
  ~HandLead();
  HandLead(const HandLead&) = delete;
  HandLead& operator=(const HandLead&) = delete;

  // Never waits. A target beyond the workspace counts as the nearest place of it; one that is not
  // finite ends the lead. Bit n of `buttons`: the stylus's button n is pressed. `R_DS`: how the
  // stylus is to be turned, its axes in D; none: as it turns by itself.
  void MoveTo(const Vec3& p_DTarget_mm, std::uint32_t buttons = 0,
              const std::optional<Eigen::Quaterniond>& R_DS = {});

  HandLeadState state() const;
  // For people: who leads the hand instead, that the device is not the simulated one, that our role
  // does not allow it, that palpated went away. Empty: it has not ended.
  std::string problem() const;

 private:
  class Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace palpate::client
