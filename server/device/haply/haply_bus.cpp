#include "server/device/haply/haply_bus.h"

#include <fmt/format.h>

#include <utility>

#include "common/error/error.h"
#include "server/device/haply/haply_session.h"
#include "server/realtime/thread_setup.h"

namespace palpate {
namespace {

// The middle of the workspace: of the vendor's samples. A Minverse's is not published.
const Vec3 kCentre_m(0.019, -0.153, 0.151);

}  // namespace

DeviceDescription HaplySpec(const std::string& model) {
  DeviceDescription spec;
  spec.kind = "haply";
  double reach_mm = 100.0;
  // Caution, until somebody has seen it. For a Minverse, no figures were found.
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  spec.max_stiffness_n_per_mm = 0.5;
  spec.position_resolution_mm = 0.01;
  if (model == "inverse3") {
    spec.model = "Haply Inverse3";
  } else if (model == "inverse3x") {
    spec.model = "Haply Inverse3x";
  } else if (model == "minverse") {
    spec.model = "Haply Minverse";
    reach_mm = 40.0;
    spec.max_force_n = 1.0;
    spec.continuous_force_n = 0.5;
    spec.max_stiffness_n_per_mm = 0.3;
    spec.position_resolution_mm = 0.05;
  } else {
    throw Error(ErrorKind::kInvalidArgument,
                fmt::format("a model must be inverse3, inverse3x or minverse, not \"{}\"", model));
  }
  spec.workspace_min_mm = Vec3::Constant(-reach_mm);
  spec.workspace_max_mm = Vec3::Constant(reach_mm);
  spec.button_count = 3;
  spec.senses_orientation = true;
  spec.verification_level = kHaplyVerification;
  return spec;
}

Vec3 InverseToM(const Vec3& p_m) {
  const Vec3 q_mm = 1000.0 * (p_m - kCentre_m);
  return {q_mm.x(), q_mm.z(), -q_mm.y()};
}

Vec3 InverseFromM(const Vec3& force_n) { return {force_n.x(), -force_n.z(), force_n.y()}; }

Eigen::Quaterniond InverseGripToM(const Eigen::Quaterniond& orientation) {
  Eigen::Matrix3d to_M;
  to_M << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  return Eigen::Quaterniond(
             Eigen::Matrix3d(to_M * orientation.toRotationMatrix() * to_M.transpose()))
      .normalized();
}

std::vector<InverseArm> FindInverseArms(std::uint16_t port) {
  constexpr std::chrono::milliseconds kLongest{500};
  const std::atomic<bool> never{false};
  InverseLink link(port, kLongest, never);
  const auto end = std::chrono::steady_clock::now() + kLongest;
  std::optional<InverseReply> inventory;
  while (!inventory && std::chrono::steady_clock::now() < end) {
    link.Wait(std::chrono::milliseconds(20));
    if (const auto message = link.TakeMessage()) inventory = ParseInverse(message->text);
  }
  link.Close(std::chrono::milliseconds(50));
  if (inventory) return inventory->arms;
  throw BusError(BusFault::kTimeout, "what answers there is not Haply's service");
}

HaplyBus::HaplyBus(HaplyOptions options)
    : options_(std::move(options)), spec_(HaplySpec(options_.model)) {}

std::unique_ptr<StreamSession> HaplyBus::Open(const std::atomic<bool>& stop) {
  const OrdinaryScheduling ordinary;
  return std::make_unique<HaplySession>(options_, hint_, stop);
}

}  // namespace palpate
