#include "client/cli/place_options.h"

#include <fmt/core.h>

#include "client/cli/place_command.h"
#include "palpate/v1/registration.pb.h"

namespace palpate::cli {
namespace {

arguments::Option* AddTriple(arguments::Command& command, const std::string& name,
                             std::vector<double>& values, const std::string& about) {
  return command.add_option(name, values, about)
      ->delimiter(',')
      ->expected(3)
      ->check(arguments::Finite())
      ->option_text("X,Y,Z");
}

void AddAbsolute(arguments::Command& command, PlaceValues& values) {
  command.add_flag("--reset", values.reset,
                   "First into the middle of the workspace, fitted, not turned");
  AddTriple(command, "--center-mm", values.center_mm, "Where the volume's centre is to be");
  command
      .add_option("--rotation-wxyz", values.rotation_wxyz,
                  "Its turn, from the world's axes (LPS) to the device's: a unit quaternion")
      ->delimiter(',')
      ->expected(4)
      ->check(arguments::Finite())
      ->option_text("W,X,Y,Z");
  arguments::Option* scale =
      command.add_option("--device-mm-per-volume-mm", values.device_mm_per_volume_mm,
                         "mm of the device per mm of the volume");
  arguments::Option* voxel = command.add_option("--device-mm-per-voxel", values.device_mm_per_voxel,
                                                "mm of the device per shortest edge of a voxel");
  arguments::Option* cells =
      command.add_option("--cells-per-mm", values.cells_per_mm, "The same as 1 mm = N cells");
  for (arguments::Option* option : {scale, voxel, cells}) option->check(arguments::Positive());
  voxel->excludes(scale);
  cells->excludes(scale)->excludes(voxel);
}

void AddRelative(arguments::Command& command, PlaceValues& values) {
  AddTriple(command, "--move-mm", values.move_mm, "Then moves it by this much");
  command
      .add_option("--turn-deg", values.turn_deg,
                  "Turns it about an axis of the device through its centre, as in y,90")
      ->option_text("x|y|z,DEGREES");
  command.add_option("--scale-by", values.scale_by, "Scales it about its centre")
      ->check(arguments::Positive());
}

void Take(const arguments::Command& command, const PlaceValues& values,
          v1::UpdateRegistrationRequest& request) {
  const auto given = [&](const char* name) { return command.get_option(name)->count() > 0; };
  request.set_reset(values.reset);
  if (given("--center-mm")) Set(values.center_mm, *request.mutable_center_mm());
  if (given("--rotation-wxyz")) {
    v1::Quaternion& rotation = *request.mutable_rotation();
    rotation.set_w(values.rotation_wxyz[0]);
    rotation.set_x(values.rotation_wxyz[1]);
    rotation.set_y(values.rotation_wxyz[2]);
    rotation.set_z(values.rotation_wxyz[3]);
  }
  if (given("--device-mm-per-volume-mm")) {
    request.set_device_mm_per_volume_mm(values.device_mm_per_volume_mm);
  }
  if (given("--device-mm-per-voxel")) request.set_device_mm_per_voxel(values.device_mm_per_voxel);
  if (given("--cells-per-mm")) request.set_device_mm_per_voxel(1.0 / values.cells_per_mm);
  if (given("--move-mm")) Set(values.move_mm, *request.mutable_translate_mm());
  if (given("--turn-deg") && !ParseTurn(values.turn_deg, *request.mutable_rotate())) {
    throw arguments::UsageError(fmt::format(
        "--turn-deg cannot be '{}': give an axis and degrees, as in y,90", values.turn_deg));
  }
  if (given("--scale-by")) request.set_scale_by(values.scale_by);
}

}  // namespace

void AddPlace(arguments::Command& app, Invocation& invocation, PlaceValues& values) {
  arguments::Command* command = app.add_subcommand(
      "place",
      "Shows where the volume lies in the device's workspace, or moves it there at one tick.\n"
      "The device's axes: mm, x right, y up, z towards the user. What is named is changed:\n"
      "first --reset, then what is absolute, then what is relative. Kept for the volume.");
  SetFooter(*command,
            "Examples: palpate place --json\n"
            "          palpate place --move-mm 10,0,0 --turn-deg y,90\n"
            "          palpate place --reset --cells-per-mm 2");
  AddAbsolute(*command, values);
  AddRelative(*command, values);
  arguments::Option* expected =
      command->add_option("--expected-revision", values.expected_revision,
                          "Change it only on top of this settings revision, else exit with 7");
  command->add_flag("--json", values.json, "One JSON object instead of text");
  command->callback([command, &invocation, &values, expected] {
    v1::UpdateRegistrationRequest request;
    Take(*command, values, request);
    const bool changes = request.ByteSizeLong() > 0;
    if (expected->count() > 0) {
      if (!changes) throw arguments::UsageError("--expected-revision is for a change: name one");
      request.set_expected_revision(values.expected_revision);
    }
    invocation.command = [request, changes, &values](const Connection& c) {
      changes ? ChangePlace(c, request, values.json) : ShowPlace(c, values.json);
    };
  });
}

}  // namespace palpate::cli
