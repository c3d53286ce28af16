#include "server/kept/registration_file.h"

#include <fmt/core.h>

#include <optional>

#include "server/felt/registration.h"
#include "server/kept/state_file.h"

namespace palpate {
namespace {

constexpr const char* kTable = "registration";
constexpr const char* kAxesTable = "orientation";

toml::table ToTable(const StoredRegistration& entry) {
  const Eigen::Quaterniond& q = entry.R_DW;
  return toml::table{
      {"source", entry.source},
      {"size", ToTomlArray(entry.size.cast<std::int64_t>())},
      {"spacing_mm", ToTomlArray(entry.spacing_mm)},
      {"center_mm", ToTomlArray(entry.p_DCenter_mm)},
      {"rotation_wxyz", ToTomlArray(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()))},
      {"device_mm_per_volume_mm", entry.device_mm_per_volume_mm},
  };
}

// Does not check whether the registration is valid: MakeVolumePlace does.
std::optional<StoredRegistration> ToEntry(const toml::node& node) {
  const toml::table* table = node.as_table();
  if (!table) return std::nullopt;
  const auto source = (*table)["source"].value_exact<std::string>();
  const auto size = TomlNumbers<3>(*table, "size");
  const auto spacing_mm = TomlNumbers<3>(*table, "spacing_mm");
  const auto center_mm = TomlNumbers<3>(*table, "center_mm");
  const auto rotation = TomlNumbers<4>(*table, "rotation_wxyz");
  const auto scale = TomlNumber(*table, "device_mm_per_volume_mm");
  if (!source || !size || !spacing_mm || !center_mm || !rotation || !scale) return std::nullopt;
  StoredRegistration entry;
  entry.source = *source;
  // No volume has a size outside of this range.
  if ((size->array() >= 1.0).all() && (size->array() <= 1e9).all()) entry.size = size->cast<int>();
  entry.spacing_mm = *spacing_mm;
  entry.p_DCenter_mm = *center_mm;
  entry.R_DW = Eigen::Quaterniond((*rotation)[0], (*rotation)[1], (*rotation)[2], (*rotation)[3]);
  entry.device_mm_per_volume_mm = *scale;
  return entry;
}

std::optional<StoredAxes> ToAxes(const toml::node& node) {
  const toml::table* table = node.as_table();
  if (!table) return std::nullopt;
  const auto voxels = (*table)["voxels"].value_exact<std::string>();
  const auto axes = (*table)["patient_axes"].value_exact<std::string>();
  if (!voxels || !axes || !IsAnsweredAxes(*axes)) return std::nullopt;
  return StoredAxes{*voxels, *axes};
}

template <class Entry>
void Take(const toml::array& nodes, std::optional<Entry> (*to_entry)(const toml::node&),
          std::vector<Entry>& entries, std::string& damage) {
  for (const toml::node& node : nodes) {
    if (auto entry = to_entry(node)) {
      entries.push_back(*std::move(entry));
    } else {
      damage = fmt::format("the entry at line {} is incomplete", node.source().begin.line);
    }
  }
}

void Take(const toml::table& file, RegistrationFile& result) {
  if (file.empty()) return;
  const toml::array* entries = file[kTable].as_array();
  const toml::array* axes = file[kAxesTable].as_array();
  if (!entries && !axes) {
    result.damage = fmt::format("there is no [[{}]] in it", kTable);
    return;
  }
  if (entries) Take(*entries, ToEntry, result.entries, result.damage);
  if (axes) Take(*axes, ToAxes, result.axes, result.damage);
}

}  // namespace

RegistrationFile ReadRegistrations(const std::filesystem::path& path) {
  const StateFile file = ReadStateFile(path);
  RegistrationFile result{{}, {}, file.damage};
  Take(file.table, result);
  return result;
}

void WriteRegistrations(const std::filesystem::path& path,
                        const std::vector<StoredRegistration>& entries,
                        const std::vector<StoredAxes>& axes) {
  toml::array array, axes_array;
  for (const StoredRegistration& entry : entries) {
    if (HoldsAsToml(entry.source)) array.push_back(ToTable(entry));
  }
  for (const StoredAxes& entry : axes) {
    axes_array.push_back(
        toml::table{{"voxels", entry.voxels}, {"patient_axes", entry.patient_axes}});
  }
  toml::table table;
  if (!array.empty()) table.insert(kTable, std::move(array));
  if (!axes_array.empty()) table.insert(kAxesTable, std::move(axes_array));
  WriteStateFile(
      path,
      "# Where volumes lie in the workspace of the device, and where patients face in them, the\n"
      "# oldest first. palpated writes this file, and reads changes when it starts.\n",
      table);
}

}  // namespace palpate
