// `palpate device ...`: the device, and the operator's hand on its forces.
//
// Errors of all: as Connection::ErrorOf and WriteOutput.
#pragma once

#include <string>

namespace palpate::cli {

class Connection;

// What the daemon's machine has.
void PrintDevices(const Connection& connection, bool json);

// The daemon's device: what it is, how it is, what its forces do.
void PrintDevice(const Connection& connection, bool json);

void CalibrateDevice(const Connection& connection, bool json);

// Each prints the new state of the forces and since which tick it holds.
// name: of the device; empty where it needs none. Errors: also kInvalidArgument for
// another name, kFailedPrecondition where something keeps the forces off.
void EnableForces(const Connection& connection, const std::string& name, bool json);
void DisableForces(const Connection& connection, bool json);
void StopForces(const Connection& connection, bool json);

// Reads for that long and prints what came. Errors: also kInternal with the first
// reason where the device fails.
void TestDevice(const Connection& connection, double seconds, bool json);

}  // namespace palpate::cli
