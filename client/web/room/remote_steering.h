// Which changes of settings other sites' guests may make.
//
// A NATS user stands for a site: its permissions bind it to its own subject. What it may change,
// and that it changes nothing too often, is judged here, whatever the site says of its guest.
//
// Threads: one. Time is passed in.
#pragma once

#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "client/web/hub/hub.h"
#include "client/web/logins/steering_rules.h"
#include "client/web/room/nats_link.h"

namespace palpate::web {

class RemoteSteering {
 public:
  explicit RemoteSteering(std::vector<RemoteSite> sites) : sites_(std::move(sites)) {}

  // `json`: {"user", "key", "value"}. Returns the change, by user@site, or why it is refused.
  std::variant<SteerRequest, std::string> Judge(const std::string& site, std::string_view json,
                                                Time now);

 private:
  const std::vector<RemoteSite> sites_;
  SteeringRules rules_;
};

// The answer to a request; empty: done.
std::string SteerAnswer(const std::string& error);

}  // namespace palpate::web
