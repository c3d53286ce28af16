// The Edit tab: brush and filters.
#include <algorithm>
#include <string_view>
#include <vector>

#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

using client::EditOperation;
using client::Filter;
using client::FilterKind;

// In the order of FilterRegion.
constexpr std::string_view kRegions[] = {"whole volume", "crop box", "ball at the proxy"};

void EditBrush(Viewer& viewer) {
  BrushOptions& brush = viewer.state().brush;
  std::vector<std::string_view> operations = {"remove"};
  operations.insert(operations.end(), kWords<EditOperation>.begin(), kWords<EditOperation>.end());
  int operation = brush.removes ? 0 : static_cast<int>(brush.operation);
  if (Choose("Operation", operation, operations)) {
    brush.removes = operation == 0;
    if (operation > 0) brush.operation = static_cast<EditOperation>(operation);
  }
  Tip("what a stroke does, once for each voxel, within the volume's range of values; remove makes "
      "them free space");
  SharedSign(viewer, "voxels");
  DragDouble("Radius", brush.radius_mm, 0.05, kLeastBrush_mm, kGreatestBrush_mm, "%.2f mm");
  Tip("of the ball that is shown at the pointer, in mm of the volume ([ and ], comma and point, "
      "ctrl + wheel)");
  DragDouble("Fades over", brush.falloff_mm, 0.05, 0.0, 100.0, "%.2f mm");
  Tip("outside of the ball, to the fainter line");
  const auto& lattice = viewer.feed().volume().lattice();
  const double range = lattice ? lattice->value_max - lattice->value_min : 1.0;
  if (brush.removes) return;
  if (brush.operation != client::EditOperation::kSmooth) {
    DragDouble("Value", brush.value, range / 500.0, -1e9, 1e9, "%.5g");
    Tip("data units");
    if (lattice) UnitText(lattice->unit);
  }
  if (brush.operation == client::EditOperation::kSmooth ||
      brush.operation == client::EditOperation::kPaint) {
    DragDouble("Strength", brush.strength, 0.01, 0.01, 1.0, "%.2f");
    Tip("the share of the full change");
  }
}

void ChooseKind(Filter& filter, bool is_level_set) {
  if (ImGui::BeginCombo("Kind", NameOf(filter.kind).data())) {
    for (const std::string_view word : kWords<FilterKind>) {
      const FilterKind kind = *Named<FilterKind>(word);
      ImGui::BeginDisabled(IsForLevelSets(kind) && !is_level_set);
      if (ImGui::Selectable(word.data(), kind == filter.kind)) filter.kind = kind;
      ImGui::EndDisabled();
      Tip(Describe(kind).says.data());
    }
    ImGui::EndCombo();
  }
  Tip(Describe(filter.kind).says.data());
}

void EditSpacing(Filter& filter, const VolumeLattice& lattice, bool is_level_set) {
  // None chosen yet: twice as coarse.
  if (filter.spacing_mm.isZero(0.0)) filter.spacing_mm = 2.0 * lattice.spacing_mm;
  const double speed = 0.005 * lattice.spacing_mm.maxCoeff();
  static constexpr std::array<const char*, 3> kAxes = {"Spacing x", "Spacing y", "Spacing z"};
  for (int axis = 0; axis < (is_level_set ? 1 : 3); ++axis) {
    DragDouble(is_level_set ? "Spacing" : kAxes[static_cast<std::size_t>(axis)],
               filter.spacing_mm[axis], speed, 1e-4, 1e4, "%.3f mm");
    Tip("between the new voxels");
  }
  if (is_level_set) filter.spacing_mm = Vec3::Constant(filter.spacing_mm.x());
}

void EditParameters(Filter& filter, const VolumeLattice& lattice, bool is_level_set) {
  if (HasRegion(filter.kind)) {
    ImGui::SliderInt("Voxels around", &filter.width, 1, 8, "%d", ImGuiSliderFlags_AlwaysClamp);
    Tip("as many voxels to each side");
  }
  if (const int most = MostIterations(filter.kind, filter.width); most > 0) {
    filter.iterations = std::min(filter.iterations, most);
    ImGui::SliderInt("Times", &filter.iterations, 1, most, "%d", ImGuiSliderFlags_AlwaysClamp);
    Tip("how often the filter is applied");
  }
  if (filter.kind == FilterKind::kOffset) {
    const double voxel_mm = lattice.spacing_mm.minCoeff();
    DragDouble("Distance", filter.distance_mm, 0.02 * voxel_mm, -128.0 * voxel_mm, 128.0 * voxel_mm,
               "%.2f mm");
    Tip("outwards; negative: inwards");
  }
  if (filter.kind == FilterKind::kResample) EditSpacing(filter, lattice, is_level_set);
}

void EditRegion(FilterForm& form) {
  if (!HasRegion(form.filter.kind)) return;
  Choose("Where", form.region, kRegions);
  Tip("the voxels that are replaced");
  if (form.region != FilterRegion::kProxyBall) return;
  DragDouble("Ball", form.radius_mm, 0.05, 0.1, 1000.0, "%.2f mm");
  Tip("radius around the point where the stylus touches the surface");
}

std::optional<Vec3> ProxyInWorld(const Viewer& viewer) {
  const ViewVolume& volume = viewer.feed().volume();
  const auto& pose = viewer.feed().pose();
  const std::optional<AffineMap> X_DW = volume.X_DW();
  if (!pose || !X_DW) return std::nullopt;
  return X_DW->Inverse().Apply(pose->scp_h_mm);
}

void StartOrCancel(Viewer& viewer, const VolumeLattice& lattice, bool is_level_set) {
  Task<client::EditResult>& run = viewer.feed().filter();
  if (const std::optional<client::Progress> progress = run.progress()) {
    ImGui::ProgressBar(static_cast<float>(progress->fraction),
                       {0.58f * ImGui::GetContentRegionAvail().x, 0});
    ImGui::SameLine();
    if (ImGui::Button("Cancel")) run.Cancel();
    Tip("the volume stays as it is");
    return;
  }
  const FilterForm& form = viewer.state().filter;
  const std::optional<Filter> filter =
      FilterOf(form, viewer.state().surface.crop, lattice.size, ProxyInWorld(viewer));
  const bool moves = form.filter.kind != FilterKind::kOffset || form.filter.distance_mm != 0.0;
  const bool fits = is_level_set || !IsForLevelSets(form.filter.kind);
  ImGui::BeginDisabled(!filter || !moves || !fits);
  if (ImGui::Button("Apply the filter")) {
    const std::string name(NameOf(form.filter.kind));
    run.Start("filter", [filter = *filter, done = viewer.brush().OtherStroke(name)](
                            client::Client& client, const client::ProgressFunction& progress) {
      client::EditResult result = client.RunFilter(filter, progress);
      done(result);
      return result;
    });
  }
  ImGui::EndDisabled();
  Tip(fits ? "one step to undo" : "the volume is no level set");
  SharedSign(viewer, "voxels");
}

void FilterPart(Viewer& viewer) {
  const auto& lattice = viewer.feed().volume().lattice();
  if (!lattice) return;
  const std::optional<client::VolumeInfo> info = viewer.feed().volume_info();
  const bool is_level_set = info && info->is_level_set;
  FilterForm& form = viewer.state().filter;
  BeginAllowed(viewer, client::Role::kEditor);
  ChooseKind(form.filter, is_level_set);
  EditParameters(form.filter, *lattice, is_level_set);
  EditRegion(form);
  StartOrCancel(viewer, *lattice, is_level_set);
  EndAllowed();
  const std::string problem = viewer.feed().filter().problem();
  if (!problem.empty()) WrappedText(kWarning, problem);
}

}  // namespace

void EditTab(Viewer& viewer) {
  if (ImGui::CollapsingHeader("Brush", ImGuiTreeNodeFlags_DefaultOpen)) {
    BeginAllowed(viewer, client::Role::kEditor);
    EditBrush(viewer);
    EndAllowed();
  }
  if (ImGui::CollapsingHeader("Filter", ImGuiTreeNodeFlags_DefaultOpen)) FilterPart(viewer);
}

}  // namespace palpate::view
