// Checks the ports of palpated: does another program use them, and does palpated answer there?
//
// Threads: any. Errors: none. If something cannot be read, the finding says so.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/cli/doctor/checks.h"

namespace palpate::doctor {

// Checks the ports for clients and for Prometheus. Reads them from /etc/palpate/palpated.toml. A
// port that the file does not set is the one that the file's comments propose.
Finding CheckPort(const Workstation& machine);
Finding CheckMetricsPort(const Workstation& machine);

// Checks further ports of a running palpated, such as those of --listen.
std::vector<Finding> CheckDaemonPorts(const Workstation& machine);

// Begins TLS with the port. Returns false if no byte comes back within two seconds. A server
// without TLS answers too: gRPC sends its settings to everybody, HTTP refuses what is no request.
// Other greetings would leave an error in the log of a server with TLS.
bool Answers(const std::string& host, std::uint16_t port);

}  // namespace palpate::doctor
