#include "client/web/source/pose_bytes.h"

#include <bit>
#include <cstring>
#include <limits>

namespace palpate::web {
namespace {

static_assert(std::endian::native == std::endian::little);

// Writes values one after the other, as they lie in memory.
class Writer {
 public:
  template <class T>
  void Put(T value) {
    std::memcpy(&bytes_.at(at_), &value, sizeof(value));
    at_ += sizeof(value);
  }
  void PutSingle(double value) { Put(static_cast<float>(value)); }
  void PutVector(const Vec3& v) {
    for (const double value : v) PutSingle(value);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_ = std::string(kPoseBytes, '\0');
  std::size_t at_ = 0;
};

std::uint8_t Flags(const client::Pose& pose, bool is_fresh) {
  return static_cast<std::uint8_t>(
      (pose.contact ? kContact : 0) | (pose.scp_h_normal ? kHasNormal : 0) |
      (pose.scp_v_mm ? kHasScpV : 0) |
      (pose.free_side == client::FreeSide::kAbove ? kFreeAbove : 0) | (is_fresh ? kFresh : 0));
}

}  // namespace

std::string EncodePose(const client::Pose& pose, const PoseSending& sending) {
  const auto ms = [](std::int64_t ns) { return 1e-6 * static_cast<double>(ns); };
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  Writer writer;
  writer.Put(std::uint8_t{1});
  writer.Put(Flags(pose, sending.is_fresh));
  writer.Put(static_cast<std::uint8_t>(pose.mode));
  writer.Put(static_cast<std::uint8_t>(pose.forces.state));
  writer.Put(std::uint32_t{0});
  writer.Put(static_cast<double>(pose.tick));
  writer.Put(ms(pose.time_ns));
  writer.Put(ms(sending.sent_ns));
  writer.Put(sending.shares_clock ? ms(sending.sent_ns - pose.time_ns) : kUnknown);
  writer.Put(static_cast<double>(pose.settings_revision));
  writer.Put(static_cast<double>(pose.volume_revision));
  writer.PutVector(pose.hip_mm);
  writer.PutVector(pose.scp_h_mm);
  writer.PutVector(pose.scp_h_normal.value_or(Vec3::Zero()));
  writer.PutVector(pose.scp_v_mm.value_or(Vec3::Zero()));
  for (const double value : pose.stylus_orientation.coeffs()) writer.PutSingle(value);
  writer.PutVector(pose.force_n);
  writer.PutSingle(pose.forces.limit_n);
  writer.PutSingle(pose.density);
  writer.PutSingle(pose.isovalue);
  writer.Put(pose.buttons);
  writer.Put(static_cast<std::uint32_t>(pose.missed_ticks));
  writer.PutSingle(1e-3 * static_cast<double>(pose.update_ns));
  writer.Put(static_cast<std::uint8_t>(pose.forces.reason));
  return writer.bytes();
}

}  // namespace palpate::web
