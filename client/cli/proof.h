// What `palpate device prove` has found out, for the folder that is sent.
//
// No personal data: no names of users, hosts or volumes, no paths, no addresses.
// Frame D (mm, N). Pure; any thread.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "client/cli/description.h"
#include "client/sdk/device.h"
#include "client/sdk/pose.h"
#include "common/error/error.h"

namespace palpate::cli {

struct Proof {
  client::DaemonInfo daemon{};  // the newest
  std::vector<client::ListedDevice> devices{};
  bool rehearsal = false;                // there is no hardware to prove
  Json steps = Json::array();            // each with its name, its time and its figures
  std::string step{};                    // the last one that began
  std::optional<Error> refusal{};        // why it ended early; none: all was right
  std::vector<client::Pose> readings{};  // of the steps that measure
  // What the steps so far would raise the level to.
  client::VerificationLevel level = client::VerificationLevel::kNone;
};

// The programs and the machine.
struct ProofVersions {
  std::string client{};
  std::string kernel{};
  std::string machine{};
  std::string system{};
};

// Replaces what looks like a path.
std::string WithoutPaths(const std::string& text);

Json ToJson(const Proof& proof, const ProofVersions& versions);
// A table of comma-separated values.
std::string TableOf(const std::vector<client::Pose>& readings);

}  // namespace palpate::cli
