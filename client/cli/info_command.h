// `palpate info` and `palpate settings`.
#pragma once

namespace palpate::cli {

class Connection;

// Prints what there is: daemon, device, servo, volume, settings.
// Errors: as Connection::Call and WriteOutput.
void PrintInfo(const Connection& connection, bool json);

// Prints the settings alone.
void PrintSettings(const Connection& connection, bool json);

}  // namespace palpate::cli
