#include "server/lab/load_volume.h"

#include <cstdio>
#include <vector>

#include "common/error/error.h"
#include "server/live_volume/volume_loader.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate::lab {

std::filesystem::path ImportProgramBesideThis() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "palpate-import";
}

std::shared_ptr<const VolumeSnapshot> LoadVolume(const std::string& source,
                                                 const std::filesystem::path& import_program,
                                                 const StageProgress& progress,
                                                 const std::optional<Vec3>& spacing_mm) {
  const std::string absolute =
      IsBuiltin(source) ? source : std::filesystem::absolute(source).string();
  const VolumeLoader loader{.import_program = import_program};
  std::vector<std::string> warnings;
  const LoadedVolume volume = loader.Load(
      {.source = absolute, .spacing_mm = spacing_mm},
      [&](std::string_view stage, double fraction) {
        if (progress) progress(stage, fraction);
      },
      [] { return false; }, warnings);
  for (const std::string& warning : warnings) {
    std::fprintf(stderr, "%s: %s\n", source.c_str(), warning.c_str());
  }
  return std::make_shared<const VolumeSnapshot>(volume.metadata, volume.bricks, 1, 1);
}

double ChooseIsovalue(const VolumeSnapshot& volume, const std::optional<double>& isovalue,
                      const std::optional<double>& normalized_isovalue) {
  if (isovalue.has_value() == normalized_isovalue.has_value()) {
    throw Error(ErrorKind::kInvalidArgument,
                "give the isovalue either in data units or normalised");
  }
  const double density = isovalue ? volume.Normalize(*isovalue) : *normalized_isovalue;
  if (!(density >= 0.0 && density <= 1.0)) {
    const VolumeMetadata& metadata = volume.metadata();
    char text[160];
    std::snprintf(text, sizeof text,
                  "the isovalue %g is outside of the volume's range, %g to %g (normalised: 0 to 1)",
                  isovalue ? *isovalue : *normalized_isovalue, metadata.value_min,
                  metadata.value_max);
    throw Error(ErrorKind::kInvalidArgument, text);
  }
  return density;
}

}  // namespace palpate::lab
