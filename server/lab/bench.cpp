#include "server/lab/commands.h"

#include <fmt/core.h>

#include <algorithm>
#include <ostream>

#include "server/lab/trajectory.h"

namespace palpate::lab {
namespace {

void PrintTable(const FixedSlide& slide, const ReplaySummary& s, std::ostream& out) {
  const Verdict& v = s.verdict;
  out << fmt::format(
      "{:<17} {:>5.1f} {:>7} {:>6} {:>6} {:>6} {:>7.2f} {:>7.2f} {:>7.2f} {:>8.1f} {:>8.3f} "
      "{:>8.4f} {:>6.2f}\n",
      slide.name, 100.0 * s.contact_share(), v.fall_throughs, *v.sticks, v.excess_force_ticks,
      v.iteration_cap_hits, s.mean_ns * 1e-3, static_cast<double>(s.p50_ns) * 1e-3,
      static_cast<double>(s.p99_ns) * 1e-3, static_cast<double>(s.max_ns) * 1e-3,
      100.0 * s.scp_v_share(), s.mean_scp_hv_voxels(), s.mean_force_angle_deg());
  out.flush();  // the next slide takes seconds
}

// Sums the counts of all slides. Times are means over the slides; max_ns is the largest.
ReplaySummary Total(const std::vector<ReplaySummary>& summaries) {
  ReplaySummary total;
  const auto count = static_cast<double>(summaries.size());
  double p50_ns = 0.0, p99_ns = 0.0;
  for (const ReplaySummary& s : summaries) {
    total.ticks += s.ticks;
    Verdict& sum = total.verdict;
    const Verdict& v = s.verdict;
    sum.contact_ticks += v.contact_ticks;
    sum.ejecting_ticks += v.ejecting_ticks;
    sum.rejected_ticks += v.rejected_ticks;
    sum.iteration_cap_hits += v.iteration_cap_hits;
    sum.fall_throughs += v.fall_throughs;
    *sum.sticks += *v.sticks;
    sum.excess_force_ticks += v.excess_force_ticks;
    sum.excess_off_minimum_ticks += v.excess_off_minimum_ticks;
    sum.unchecked_ticks += v.unchecked_ticks;
    sum.scp_v_ticks += v.scp_v_ticks;
    sum.scp_v_off_ticks += v.scp_v_off_ticks;
    sum.scp_hv_voxels += v.scp_hv_voxels;
    sum.force_angle_deg += v.force_angle_deg;
    total.mean_ns += s.mean_ns / count;
    p50_ns += static_cast<double>(s.p50_ns) / count;
    p99_ns += static_cast<double>(s.p99_ns) / count;
    total.max_ns = std::max(total.max_ns, s.max_ns);
  }
  total.p50_ns = static_cast<std::int64_t>(p50_ns);
  total.p99_ns = static_cast<std::int64_t>(p99_ns);
  return total;
}

}  // namespace

ReplaySummary RunFixedSlide(const FixedSlide& slide, int passes, int refinement,
                            double ball_voxels) {
  const LoadedSurface loaded = LoadSurface({.volume = slide.volume,
                                            .isovalue = 0.5,
                                            .normalized = true,
                                            .spacing_mm = {slide.spacing_mm},
                                            .ball_voxels = ball_voxels});
  const std::vector<Vec3> hips_mm = MakeTrajectory(
      *loaded.volume, {.isovalue = loaded.isovalue, .speed_cm_per_s = slide.speed_cm_per_s});
  HapticSettings settings;
  settings.refinement = refinement;
  return ReplayAndJudge(loaded, DecompositionMethod::kTpbcc, settings, hips_mm, passes).summary;
}

void RunBench(const BenchOptions& options, std::ostream& out) {
  if (!options.json) {
    out << fmt::format(
        "{:<17} {:>5} {:>7} {:>6} {:>6} {:>6} {:>7} {:>7} {:>7} {:>8} {:>8} {:>8} {:>6}\n", "slide",
        "felt%", "through", "stick", "excess", "capped", "mean_us", "p50_us", "p99_us", "max_us",
        "SCP_V%", "HV_voxel", "deg");
  }
  std::vector<ReplaySummary> summaries;
  std::string trajectories;
  for (const FixedSlide& slide : kFixedSlides) {
    summaries.push_back(
        RunFixedSlide(slide, options.passes, options.refinement, options.ball_voxels));
    if (!options.json) PrintTable(slide, summaries.back(), out);
    // The slide's name comes first in its object.
    trajectories += fmt::format("{}{{\"name\":\"{}\",{}", trajectories.empty() ? "" : ",",
                                slide.name, ToJson(summaries.back()).substr(1));
  }
  if (!options.json) return;
  std::string total = ToJson(Total(summaries));
  total.pop_back();
  out << total << ",\"trajectories\":[" << trajectories << "]}\n";
}

}  // namespace palpate::lab
