#include "server/import/dicom_stack.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/import/image_header.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {
namespace {

// Relative difference of a pitch from the median: up to kEvenPitch without a warning. From
// kMissingSlice times the median on, a slice is missing.
constexpr double kEvenPitch = 0.01;
constexpr double kMissingSlice = 1.5;
// Pitches that differ by less, relatively, were planned to be the same.
constexpr double kSamePitch = 0.1;
// Sideways drift of the stack per length; more is a gantry tilt.
constexpr double kStraight = 0.01;

DicomStack SortedStack(std::vector<DicomSlice> slices) {
  const DicomSlice first = slices.front();
  DicomStack stack;
  stack.direction << first.row_W, first.column_W, first.row_W.cross(first.column_W);
  const Vec3 normal_W = stack.direction.col(2);
  std::sort(slices.begin(), slices.end(), [&](const DicomSlice& a, const DicomSlice& b) {
    return normal_W.dot(a.position_W_mm) < normal_W.dot(b.position_W_mm);
  });
  for (const DicomSlice& slice : slices) {
    stack.places_mm.push_back(stack.direction.transpose() * slice.position_W_mm);
  }
  stack.slices = std::move(slices);
  return stack;
}

double Median(std::vector<double> numbers) {
  std::ranges::sort(numbers);
  return 0.5 * (numbers[(numbers.size() - 1) / 2] + numbers[numbers.size() / 2]);
}

// The line that most of a stack's slices lie on. z is along the normal.
struct Line {
  Vec3 middle_mm;  // its place in the middle of the stack
  Vec3 slope;      // mm aside for each mm along the normal; z is 1

  Vec3 At(double z_mm) const { return middle_mm + slope * (z_mm - middle_mm.z()); }
};

Line LineThrough(const std::vector<Vec3>& places) {
  // From slices half a stack apart. The least counts: slices that lie elsewhere make it steeper.
  std::vector<Vec3> slopes;
  const std::size_t half = places.size() / 2;
  for (std::size_t k = 0; k + half < places.size(); ++k) {
    const Vec3 along = places[k + half] - places[k];
    slopes.push_back(along / along.z());
  }
  const Vec3 slope = *std::ranges::min_element(slopes, {}, [](const Vec3& s) { return s.norm(); });
  const double middle_mm = 0.5 * (places.front().z() + places.back().z());
  std::vector<double> x, y;
  for (const Vec3& place : places) {
    const Vec3 straight = place - slope * (place.z() - middle_mm);
    x.push_back(straight.x());
    y.push_back(straight.y());
  }
  return {{Median(x), Median(y), middle_mm}, slope};
}

// Refuses or warns of slices that will not be where their files say: the volume's lie above each
// other. Sets where the volume begins.
void FindLine(DicomStack* stack, Reporter* reporter) {
  const std::vector<Vec3>& places = stack->places_mm;
  const Line line = LineThrough(places);
  stack->first_mm = {line.middle_mm.x(), line.middle_mm.y(), places.front().z()};
  const auto& voxel_mm = stack->slices.front().spacing_mm;
  const auto voxels = [&](const Vec3& off_mm) {
    return std::max(std::abs(off_mm.x()) / voxel_mm[0], std::abs(off_mm.y()) / voxel_mm[1]);
  };
  const auto off_mm = [&](const Vec3& place) { return Vec3(place - line.At(place.z())); };
  const auto worst = std::ranges::max_element(
      places, {}, [&](const Vec3& place) { return voxels(off_mm(place)); });
  const std::string beside =
      "the slice " +
      FileName(stack->slices[static_cast<std::size_t>(worst - places.begin())].file) + " lies " +
      Short(off_mm(*worst).norm()) + " mm beside the line that the others lie on; ";
  if (voxels(off_mm(*worst)) > kFarOff) {
    Refuse(beside + "correct the positions, or export the series again");
  }
  const Vec3 aside_mm = line.At(places.back().z()) - line.At(places.front().z());
  const std::string tilted =
      "the stack is tilted against its slices (gantry tilt): from the first to the last they move "
      "aside by " +
      Short(aside_mm.head<2>().norm()) + " mm; ";
  if (line.slope.head<2>().norm() > kStraight || voxels(0.5 * aside_mm) > kFarOff) {
    Refuse(tilted + "resample it first");
  }
  if (voxels(off_mm(*worst)) > kSlightlyOff) reporter->Warn(beside + "it is put on that line");
  if (voxels(0.5 * aside_mm) > kSlightlyOff) reporter->Warn(tilted + "they are put straight");
}

// Refuses slices at one place, and a gap where slices are missing: a single long pitch between
// others. Several long pitches in a row were planned so.
void CheckGaps(const DicomStack& stack, const std::vector<double>& pitches) {
  std::vector<double> sorted = pitches;
  std::sort(sorted.begin(), sorted.end());
  // The lower of two middle values, so that a gap is found even if it is half of all pitches.
  const double median = sorted[(sorted.size() - 1) / 2];
  const auto is_like = [&](std::size_t k, std::size_t neighbour) {
    return neighbour < pitches.size() &&
           std::abs(pitches[neighbour] - pitches[k]) < kSamePitch * pitches[k];
  };
  for (std::size_t k = 0; k < pitches.size(); ++k) {
    const std::string pair =
        FileName(stack.slices[k].file) + " and " + FileName(stack.slices[k + 1].file);
    if (pitches[k] < 0.1 * median || median < kLeastSpacingMm) {
      Refuse("the slices " + pair + " lie at the same place; keep one phase of the series");
    }
    if (pitches[k] > kMissingSlice * median && !is_like(k, k - 1) && !is_like(k, k + 1)) {
      Refuse("a slice is missing between " + pair + " (" + Short(pitches[k]) + " mm instead of " +
             Short(median) + " mm); export the series again");
    }
  }
}

// Finds the volume's slices: as many as the stack's, at their mean pitch, if that moves none of
// them far. Otherwise they are resampled.
void FindPitch(const ImportLimits& limits, DicomStack* stack, Reporter* reporter) {
  const std::vector<Vec3>& places = stack->places_mm;
  std::vector<double> pitches;
  for (std::size_t k = 1; k < places.size(); ++k) {
    pitches.push_back(places[k].z() - places[k - 1].z());
  }
  CheckGaps(*stack, pitches);
  const double length_mm = places.back().z() - places.front().z();
  stack->count = static_cast<std::int64_t>(places.size());
  stack->pitch_mm = length_mm / static_cast<double>(pitches.size());
  if (limits.spacing_is_given) return;
  double off_mm = 0.0;
  for (std::size_t k = 0; k < places.size(); ++k) {
    const double even_mm = static_cast<double>(k) * stack->pitch_mm;
    off_mm = std::max(off_mm, std::abs(places[k].z() - places.front().z() - even_mm));
  }
  const auto [least, greatest] = std::ranges::minmax(pitches);
  const std::string uneven =
      "the slices are unevenly spaced, " + Short(least) + " to " + Short(greatest) + " mm; ";
  const std::string moved = "their mean, " + Short(stack->pitch_mm) + " mm, would put one " +
                            Short(off_mm) + " mm from its place";
  if (off_mm > kSlightlyOff * stack->pitch_mm) {
    if (!limits.may_resample) {
      Refuse(uneven + moved + "; leave --no-resample out, or export slices at one spacing");
    }
    stack->is_resampled = true;
    // At most a half pitch beyond the last slice, or short of it.
    stack->count = 1 + std::llround(std::min(length_mm / least, 1e9));
    stack->pitch_mm = least;
    reporter->Warn(uneven + moved + ", so " + std::to_string(stack->count) + " slices, one each " +
                   Short(least) + " mm, are interpolated from the " +
                   std::to_string(places.size()) + " (palpate-import --no-resample refuses)");
  } else if (greatest - least > kEvenPitch * stack->pitch_mm) {
    reporter->Warn(uneven + "their mean is taken, which moves a slice by up to " + Short(off_mm) +
                   " mm");
  }
}

}  // namespace

DicomStack MakeStack(std::vector<DicomSlice> slices, const ImportLimits& limits,
                     Reporter* reporter) {
  DicomStack stack = SortedStack(std::move(slices));
  FindPitch(limits, &stack, reporter);
  FindLine(&stack, reporter);
  return stack;
}

}  // namespace palpate
