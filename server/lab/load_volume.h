// Volumes and isovalues as the lab's command lines give them.
//
// Threads: any ordinary thread; blocks until done. Errors: Error.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "server/volume/snapshot.h"

namespace palpate::lab {

using StageProgress = std::function<void(std::string_view stage, double fraction)>;

// The palpate-import that lies beside the running program.
std::filesystem::path ImportProgramBesideThis();

// `source`: a path, relative ones too, or a builtin name. Warnings go to standard
// error. `progress` may be empty. `spacing_mm`: instead of the volume's own.
std::shared_ptr<const VolumeSnapshot> LoadVolume(const std::string& source,
                                                 const std::filesystem::path& import_program,
                                                 const StageProgress& progress = {},
                                                 const std::optional<Vec3>& spacing_mm = {});

// The normalised form of exactly one of an isovalue in data units and a normalised
// one; kInvalidArgument where it lies outside of the volume's range.
double ChooseIsovalue(const VolumeSnapshot& volume, const std::optional<double>& isovalue,
                      const std::optional<double>& normalized_isovalue);

}  // namespace palpate::lab
