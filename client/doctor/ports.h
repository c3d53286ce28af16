// The ports of palpated: whether another program has them, and whether palpated answers.
//
// Threads: any. Errors: none; what cannot be read is said in the finding.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/doctor/checks.h"

namespace palpate::doctor {

// Where palpated listens for clients, and for Prometheus: as /etc/palpate/palpated.toml
// says, and where that says nothing, the port that its comments propose.
Finding CheckPort(const Workstation& machine);
Finding CheckMetricsPort(const Workstation& machine);

// Other ports that a palpated has which runs, as by --listen.
std::vector<Finding> CheckDaemonPorts(const Workstation& machine);

// Sends `text` there; false where no byte comes back within two seconds.
bool Answers(const std::string& host, std::uint16_t port, const std::string& text);

}  // namespace palpate::doctor
