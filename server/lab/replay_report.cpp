#include "server/lab/replay_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

namespace palpate::lab {
namespace {

constexpr const char* kColumns =
    "tick,hip_x,hip_y,hip_z,scp_h_x,scp_h_y,scp_h_z,scp_v_x,scp_v_y,scp_v_z,scp_v_valid,contact,"
    "force_x,force_y,force_z,density,tetrahedra,iterations,update_ns\n";

// The sign of a NaN depends on its origin; the output must not show this sign.
double Plain(double number) {
  return number == number ? number : std::numeric_limits<double>::quiet_NaN();
}

void AppendVector(const Vec3& v, std::string& out) {
  fmt::format_to(std::back_inserter(out), "{},{},{},", Plain(v.x()), Plain(v.y()), Plain(v.z()));
}

std::string OrNull(const std::optional<int>& count) {
  return count ? std::to_string(*count) : "null";
}

}  // namespace

double ReplaySummary::contact_share() const {
  return ticks > 0 ? static_cast<double>(verdict.contact_ticks) / ticks : 0.0;
}

double ReplaySummary::scp_v_share() const {
  return verdict.contact_ticks > 0
             ? static_cast<double>(verdict.scp_v_ticks) / verdict.contact_ticks
             : 1.0;
}

double ReplaySummary::mean_scp_hv_voxels() const {
  return verdict.scp_hv_voxels / std::max(verdict.scp_v_ticks, 1);
}

double ReplaySummary::mean_force_angle_deg() const {
  return verdict.force_angle_deg / std::max(verdict.scp_v_ticks, 1);
}

ReplaySummary Summarise(const std::vector<ReplayTick>& ticks, Verdict verdict) {
  ReplaySummary summary;
  summary.ticks = static_cast<int>(ticks.size());
  summary.verdict = std::move(verdict);
  if (ticks.empty()) return summary;
  std::vector<std::int64_t> updates_ns;
  for (const ReplayTick& tick : ticks) updates_ns.push_back(tick.update_ns);
  std::sort(updates_ns.begin(), updates_ns.end());
  const auto quantile = [&](double share) {
    return updates_ns[static_cast<std::size_t>(share * static_cast<double>(ticks.size() - 1))];
  };
  for (std::int64_t update_ns : updates_ns) summary.mean_ns += static_cast<double>(update_ns);
  summary.mean_ns /= static_cast<double>(ticks.size());
  summary.p50_ns = quantile(0.5);
  summary.p99_ns = quantile(0.99);
  summary.max_ns = updates_ns.back();
  return summary;
}

std::string ToJson(const ReplaySummary& s) {
  const Verdict& v = s.verdict;
  return fmt::format(
      "{{\"ticks\":{},\"contact_ticks\":{},\"fall_throughs\":{},\"sticks\":{},"
      "\"excess_force_ticks\":{},\"iteration_cap_hits\":{},\"mean_ns\":{:.1f},\"p50_ns\":{},"
      "\"p99_ns\":{},\"max_ns\":{},\"ejecting_ticks\":{},\"rejected_ticks\":{},"
      "\"unchecked_ticks\":{},\"excess_off_minimum_ticks\":{},\"scp_v_share\":{:.6f},"
      "\"scp_v_off_ticks\":{},\"mean_scp_hv_voxels\":{:.6f},\"mean_force_angle_deg\":{:.4f}}}",
      s.ticks, v.contact_ticks, v.fall_throughs, OrNull(v.sticks), v.excess_force_ticks,
      v.iteration_cap_hits, s.mean_ns, s.p50_ns, s.p99_ns, s.max_ns, v.ejecting_ticks,
      v.rejected_ticks, v.unchecked_ticks, v.excess_off_minimum_ticks, s.scp_v_share(),
      v.scp_v_off_ticks, s.mean_scp_hv_voxels(), s.mean_force_angle_deg());
}

std::string ToCsv(const std::vector<ReplayTick>& ticks, const std::vector<double>& density) {
  const Vec3 none = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
  std::string out = kColumns;
  for (std::size_t n = 0; n < ticks.size(); ++n) {
    const HapticOutput& output = ticks[n].output;
    fmt::format_to(std::back_inserter(out), "{},", n);
    AppendVector(ticks[n].p_DHip_mm, out);
    AppendVector(ticks[n].placed ? output.proxy.p_DH_mm : none, out);
    const VisualProxy& visual = ticks[n].visual;
    AppendVector(visual.found ? visual.p_DV_mm : none, out);
    fmt::format_to(std::back_inserter(out), "{},{},", visual.found ? 1 : 0,
                   IsInContact(output) ? 1 : 0);
    AppendVector(output.force_D_n, out);
    fmt::format_to(std::back_inserter(out), "{},{},{},{}\n", Plain(density[n]),
                   output.proxy.tetrahedra, output.proxy.moves, ticks[n].update_ns);
  }
  return out;
}

}  // namespace palpate::lab
