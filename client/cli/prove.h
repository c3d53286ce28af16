// `palpate device prove`: the steps by which a person proves a device, apart from the terminal and
// the network.
//
// The steps: find, calibrate, readings, axes, buttons, enable, push, stop. The first thing that is
// not right ends them. Forces are off at the end, whatever happened.
// Frame D (mm, N). Threads: one.
#pragma once

#include <string>
#include <vector>

#include "client/cli/proof.h"
#include "client/sdk/device.h"
#include "client/sdk/pose.h"

namespace palpate::cli {

// Whoever holds the stylus. Errors: Error with kCancelled: the person has ended it.
class Person {
 public:
  virtual ~Person() = default;
  virtual void Say(const std::string& step, const std::string& text) = 0;
  virtual void WaitForEnter() = 0;
  virtual bool AskYesNo(const std::string& question) = 0;
};

// Errors: as client::Calls; kCancelled: the person has ended it.
class ProvedDaemon {
 public:
  virtual ~ProvedDaemon() = default;
  virtual client::DaemonInfo GetDevice() = 0;
  virtual std::vector<client::ListedDevice> ListDevices() = 0;
  virtual void EnableForces(const std::string& kind) = 0;
  virtual void DisableForces() = 0;
  // These two return the first tick that knows of it.
  virtual std::uint64_t StopForces() = 0;
  virtual std::uint64_t PushHand(const Vec3& force_n, double seconds) = 0;
  // Opens a stream of all ticks from now on.
  virtual void Follow() = 0;
  // Returns what the stream brings in the next seconds.
  virtual std::vector<client::Pose> Read(double seconds) = 0;
};

// `forces_of`: the device's kind, if its forces may be tried; otherwise empty.
// Errors: those that are no Error. The refusal of a step is in the proof.
Proof Prove(ProvedDaemon& palpated, Person& person, const std::string& forces_of);

}  // namespace palpate::cli
