#include "client/web/source/pose_bytes.h"

#include <bit>
#include <cstring>
#include <limits>

namespace palpate::web {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr double kMostMs = 1e12;  // more is no time
constexpr std::size_t kFlagsAt = 1, kSentAt = 24, kAgeAt = 32;

double InMs(std::int64_t ns) { return 1e-6 * static_cast<double>(ns); }

double NumberAt(std::string_view pose, std::size_t at) {
  double number = 0.0;
  std::memcpy(&number, pose.data() + at, sizeof(number));
  return number;
}

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
  return static_cast<std::uint8_t>((pose.contact ? kContact : 0) |
                                   (pose.scp_h_normal ? kHasNormal : 0) |
                                   (pose.scp_v_mm ? kHasScpV : 0) |
                                   (pose.free_side == client::FreeSide::kAbove ? kFreeAbove : 0) |
                                   (is_fresh ? kFresh : 0) | (pose.replayed ? kReplayed : 0));
}

}  // namespace

std::string EncodePose(const client::Pose& pose, const PoseSending& sending) {
  Writer writer;
  writer.Put(std::uint8_t{1});
  writer.Put(Flags(pose, sending.is_fresh));
  writer.Put(static_cast<std::uint8_t>(pose.mode));
  writer.Put(static_cast<std::uint8_t>(pose.forces.state));
  writer.Put(std::uint32_t{0});
  writer.Put(static_cast<double>(pose.tick));
  writer.Put(InMs(pose.time_ns));
  writer.Put(InMs(sending.sent_ns));
  writer.Put(sending.shares_clock ? InMs(sending.sent_ns - pose.time_ns) : kUnknown);
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

std::optional<std::string> ForwardedPose(std::string_view bytes, const PoseSending& sending) {
  if (bytes.size() != kPoseBytes || bytes[0] != 1) return std::nullopt;
  const double sent_ms = InMs(sending.sent_ns);
  const double way_ms = sent_ms - NumberAt(bytes, kSentAt);
  const double age_ms = PoseAgeMs(bytes) + way_ms;
  const bool is_known =
      sending.shares_clock && way_ms >= 0.0 && age_ms >= way_ms && age_ms < kMostMs;
  std::string forwarded(bytes);
  const auto put = [&](std::size_t at, double number) {
    std::memcpy(forwarded.data() + at, &number, sizeof(number));
  };
  put(kSentAt, sent_ms);
  put(kAgeAt, is_known ? age_ms : kUnknown);
  if (!sending.is_fresh) forwarded[kFlagsAt] &= static_cast<char>(~kFresh);
  return forwarded;
}

double PoseAgeMs(std::string_view pose) { return NumberAt(pose, kAgeAt); }

}  // namespace palpate::web
