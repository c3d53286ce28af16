// What the lab's command lines name: volumes, isovalues, settings.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "server/haptics/settings.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate::lab {

// Loads volumes and isovalues given on the lab's command lines.
//
// Threads: any ordinary thread; blocks until done. Errors: Error.

using StageProgress = std::function<void(std::string_view stage, double fraction)>;

// The palpate-import in the folder of the running program.
std::filesystem::path ImportProgramBesideThis();

// `source`: a path (absolute or relative) or a builtin name. Warnings go to standard error.
// `progress` may be empty. `spacing_mm`: replaces the volume's own spacing.
std::shared_ptr<const VolumeSnapshot> LoadVolume(const std::string& source,
                                                 const std::filesystem::path& import_program,
                                                 const StageProgress& progress = {},
                                                 const std::optional<Vec3>& spacing_mm = {});

// Takes an isovalue either in data units or normalised, and returns it normalised. Throws
// kInvalidArgument unless exactly one is given, and if it lies outside the volume's range.
double ChooseIsovalue(const VolumeSnapshot& volume, const std::optional<double>& isovalue,
                      const std::optional<double>& normalized_isovalue);

// Settings of the renderer given on a command line: key=value.
//
// Threads: pure functions. Errors: Error.
//
// The keys are the keys of server/haptics/settings.h, and free_side. Throws kInvalidArgument for
// other keys and for values out of range.
void ApplySetting(const std::string& argument, HapticSettings& settings);

}  // namespace palpate::lab
