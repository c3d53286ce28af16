#include "client/cli/load_options.h"

#include <map>

#include "client/cli/load_command.h"

namespace palpate::cli {
namespace {

const std::map<std::string, v1::VoxelType> kVoxelTypes = {
    {"int8", v1::VOXEL_TYPE_INT8},       {"uint8", v1::VOXEL_TYPE_UINT8},
    {"int16", v1::VOXEL_TYPE_INT16},     {"uint16", v1::VOXEL_TYPE_UINT16},
    {"int32", v1::VOXEL_TYPE_INT32},     {"uint32", v1::VOXEL_TYPE_UINT32},
    {"float32", v1::VOXEL_TYPE_FLOAT32}, {"float64", v1::VOXEL_TYPE_FLOAT64},
};

arguments::Validator VoxelTypeName() {
  return {[](const std::string& text) {
    return kVoxelTypes.contains(text) ? std::string()
                                      : "'" + text +
                                            "' is no type of voxels: give int8, uint8, int16, "
                                            "uint16, int32, uint32, float32 or float64";
  }};
}

void AddRawOptions(arguments::Command& command, LoadValues& values) {
  arguments::Option* size = command
                                .add_option("--raw-size", values.raw_size,
                                            "The file holds nothing but so many voxels, x fastest")
                                ->delimiter(',')
                                ->expected(3)
                                ->check(arguments::Positive())
                                ->option_text("X,Y,Z");
  arguments::Option* type =
      command
          .add_option("--raw-type", values.raw_type,
                      "Their type: int8, uint8, int16, uint16, int32, uint32,\n"
                      "float32 or float64")
          ->check(VoxelTypeName())
          ->option_text("TYPE");
  size->needs(type);
  type->needs(size);
  command.add_flag("--raw-big-endian", values.raw_big_endian, "Their bytes come high to low")
      ->needs(size);
  command
      .add_option("--raw-offset-bytes", values.raw_offset_bytes,
                  "Bytes before the first of them [default: 0]")
      ->check(arguments::NonNegativeNumber())
      ->needs(size)
      ->option_text("N");
}

}  // namespace

void AddVolumeOptions(arguments::Command& command, LoadValues& values) {
  arguments::Option* isovalue =
      command.add_option("--isovalue", values.isovalue, "Isovalue to start with, in data units")
          ->check(arguments::Finite());
  command
      .add_option("--normalized-isovalue", values.normalized_isovalue,
                  "Isovalue to start with, 0 to 1 over the new volume's range\n"
                  "[default: the current one; value 0 of a level set]")
      ->check(arguments::Finite())
      ->excludes(isovalue);
  command
      .add_option("--spacing-mm", values.spacing_mm,
                  "Voxel spacing X,Y,Z in mm, instead of the file's")
      ->delimiter(',')
      ->expected(3)
      ->check(arguments::Positive())
      ->option_text("X,Y,Z");
  command
      .add_option("--device-mm-per-volume-mm", values.device_mm_per_volume_mm,
                  "mm of the device per mm of the volume [default: fits the workspace]")
      ->check(arguments::Positive());
  command
      .add_option("--grid", values.grid,
                  "Which grid of a .vdb file with several: its name,\n"
                  "or NAME[K] where several have one name")
      ->option_text("NAME");
  command.add_option("--component", values.component, "Of a grid of vectors: magnitude, x, y or z")
      ->option_text("NAME");
  AddRawOptions(command, values);
}

void AddFrameOption(arguments::Command& command, LoadValues& values) {
  command
      .add_option("--frame", values.frame,
                  "Which volume of a file with several, from 0 [default: 0]")
      ->option_text("N");
}

v1::LoadVolumeRequest RequestOf(const LoadValues& values) {
  v1::LoadVolumeRequest request;
  if (values.isovalue) request.set_isovalue(*values.isovalue);
  if (values.normalized_isovalue) request.set_normalized_isovalue(*values.normalized_isovalue);
  if (!values.spacing_mm.empty()) {
    request.mutable_spacing_mm()->set_x(values.spacing_mm[0]);
    request.mutable_spacing_mm()->set_y(values.spacing_mm[1]);
    request.mutable_spacing_mm()->set_z(values.spacing_mm[2]);
  }
  if (values.device_mm_per_volume_mm) {
    request.set_device_mm_per_volume_mm(*values.device_mm_per_volume_mm);
  }
  if (values.frame) request.set_frame(*values.frame);
  request.set_grid(values.grid);
  request.set_component(values.component);
  if (values.raw_size.empty()) return request;
  v1::RawVoxels& raw = *request.mutable_raw();
  raw.set_size_x(values.raw_size[0]);
  raw.set_size_y(values.raw_size[1]);
  raw.set_size_z(values.raw_size[2]);
  raw.set_type(kVoxelTypes.at(values.raw_type));
  raw.set_big_endian(values.raw_big_endian);
  raw.set_offset_bytes(values.raw_offset_bytes);
  return request;
}

void AddLoad(arguments::Command& app, Invocation& invocation, LoadValues& values) {
  arguments::Command* command = app.add_subcommand(
      "load",
      "Replaces the volume. The volume felt so far stays until the new one is complete, and\n"
      "stays when loading fails. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command,
            "Examples: palpate load scan.nrrd --isovalue -200\n"
            "          palpate load builtin:sphere:64 --normalized-isovalue 0.5\n"
            "          palpate load a.raw --raw-size 256,256,128 --raw-type uint16");
  command
      ->add_option("source", values.source,
                   "File or DICOM folder on the daemon's machine, or builtin:NAME[:N]")
      ->required()
      ->option_text("SOURCE");
  AddVolumeOptions(*command, values);
  AddFrameOption(*command, values);
  command->callback([&invocation, &values] {
    v1::LoadVolumeRequest request = RequestOf(values);
    request.set_source(values.source);
    invocation.command = [request](const Connection& c) { LoadVolume(c, request); };
  });
}

}  // namespace palpate::cli
