// The steps of `palpate device prove`, in their order: prove.cpp has those that read,
// prove_steps.cpp those with forces.
//
// Threads: one. Ownership: borrows all. Errors: Error if a step is not right; the text says what to
// do.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "client/cli/prove.h"
#include "client/sdk/pose.h"

namespace palpate::cli {

// Judges ways of the tip.
//
// Frame D (mm, N): x right, y up, z towards the user. Pure; any thread.

// One of the six directions, as people say it.
struct Direction {
  const char* words;
  int axis;  // of frame D
  double sign;

  Vec3 unit() const { return sign * Vec3::Unit(axis); }
};
inline constexpr std::array<Direction, 6> kDirections = {{{"to the right", 0, 1.0},
                                                          {"to the left", 0, -1.0},
                                                          {"up", 1, 1.0},
                                                          {"down", 1, -1.0},
                                                          {"towards you", 2, 1.0},
                                                          {"away from you", 2, -1.0}}};

// The mean place of the tip. Not finite if there are no poses.
Vec3 PlaceOf(const std::vector<client::Pose>& poses);

// Returns what is wrong with a way of the tip, and what to do; empty: it went in that direction.
std::string ProblemOfWay(const Vec3& way_mm, const Direction& asked);

// Where the stylus points, as a unit vector.
Vec3 PointingOf(const client::Pose& pose);
// As ProblemOfWay.
std::string ProblemOfPointing(const Vec3& points, const Direction& asked);

inline constexpr double kProvePlaceS = 0.2;

class ProveSteps {
 public:
  ProveSteps(ProvedDaemon& palpated, Person& person, Proof& proof)
      : palpated_(palpated), person_(person), proof_(proof) {}

  // `forces_of`: as in Prove. Call it once.
  void Run(const std::string& forces_of);
  // Ends the forces if they were tried. It never throws: the daemon may be gone.
  void EndForces(bool in_order) noexcept;

 private:
  void Begin(const std::string& step) { proof_.step = step; }
  void Say(const std::string& text) { person_.Say(proof_.step, text); }
  void Note(const Json& figures);
  void Raise(client::VerificationLevel level);

  const client::DaemonInfo& Get() { return proof_.daemon = palpated_.GetDevice(); }
  const client::DeviceDescription& device() const { return proof_.daemon.device; }

  std::vector<client::Pose> Read(double seconds);
  // Of a stream of its own.
  std::vector<client::Pose> ReadFresh(double seconds);
  bool Await(double seconds, const std::function<bool(const client::DaemonInfo&)>& holds);

  void Find(const std::string& forces_of);
  void Calibrate();
  void Rest();
  void Axes();
  void Orientation();
  void Buttons();
  bool MayTryForces(const std::string& forces_of);
  void Enable(const std::string& kind);
  void Push(const Direction& direction);
  bool TryPush(const Direction& direction, bool is_last);
  void Stop();
  // Waits while pushes have taken their time.
  std::uint64_t PushHand(const Vec3& force_n, double seconds);

  ProvedDaemon& palpated_;
  Person& person_;
  Proof& proof_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  bool tried_forces_ = false;
};

[[noreturn]] inline void Unfit(const std::string& text) {
  throw Error(ErrorKind::kFailedPrecondition, text);
}

}  // namespace palpate::cli
