#include "client/cli/place_command.h"

#include <fmt/core.h>

#include <array>
#include <charconv>
#include <cmath>
#include <iterator>
#include <memory>
#include <numbers>
#include <sstream>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

// The letters of the patient's axes, LPS: towards and away.
constexpr std::array<std::string_view, 3> kPatientLetters = {"LR", "PA", "SI"};

constexpr double kDegreesPerRad = 180.0 / std::numbers::pi;

// The values of the options.
struct PlaceValues {
  client::PlacementChange change;
  std::vector<double> center_mm;
  std::vector<double> rotation_wxyz;
  std::optional<double> cells_per_mm;
  std::vector<double> move_mm;
  std::string turn_deg;
  client::PatientFacing facing;
};

// Returns text such as "turned by 90° about (0, 1, 0)".
std::string DescribeTurn(const client::UnalignedQuaternion& q) {
  const double sine = q.vec().norm();
  const double degrees = 2.0 * std::atan2(sine, q.w()) * kDegreesPerRad;
  if (!(degrees > 1e-9)) return "not turned";
  // Adding 0 turns a negative zero into a positive one.
  const auto part = [&](double component) { return component / sine + 0.0; };
  return fmt::format("turned by {:.6g}° about ({:.4g}, {:.4g}, {:.4g})", degrees, part(q.x()),
                     part(q.y()), part(q.z()));
}

void AddAbsolute(arguments::Command& command, PlaceValues& values) {
  command.add_flag("--reset", values.change.reset,
                   "First puts it into the middle of the workspace, fitted, without a rotation");
  AddTriple(command, "--center-mm", values.center_mm, "The place of the volume's centre");
  command
      .add_option("--rotation-wxyz", values.rotation_wxyz,
                  "Its rotation from the world's axes (LPS) to the device's: a unit quaternion")
      ->delimiter(',')
      ->expected(4)
      ->check(arguments::Finite())
      ->option_text("W,X,Y,Z");
  arguments::Option* scale =
      command.add_option("--device-mm-per-volume-mm", values.change.device_mm_per_volume_mm,
                         "mm of the device per mm of the volume");
  arguments::Option* voxel =
      command.add_option("--device-mm-per-voxel", values.change.device_mm_per_voxel,
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
  command.add_option("--scale-by", values.change.scale_by, "Scales it about its centre")
      ->check(arguments::Positive());
}

void AddFacing(arguments::Command& command, PlaceValues& values) {
  arguments::Option* face = command.add_option(
      "--face", values.facing.face,
      "Where the patient's face points in the file, as in --face=-y; only if the file states\n"
      "no orientation. Left and right follow if the file is not mirrored");
  arguments::Option* head = command.add_option("--head", values.facing.head,
                                               "Where the patient's head points, as in --head=+z");
  const auto& words = client::kWorldDirections;
  for (arguments::Option* option : {face, head}) {
    option->check(arguments::IsMember({words.begin(), words.end()}))
        ->option_text("+x|-x|+y|-y|+z|-z");
  }
  face->needs(head);
  head->needs(face);
}

client::PlacementChange ChangeOf(const PlaceValues& values, bool has_turn) {
  client::PlacementChange change = values.change;
  if (!values.center_mm.empty()) change.center_mm = VectorOf(values.center_mm);
  if (!values.rotation_wxyz.empty()) {
    const std::vector<double>& q = values.rotation_wxyz;
    change.rotation = client::UnalignedQuaternion(q[0], q[1], q[2], q[3]);
  }
  if (values.cells_per_mm) change.device_mm_per_voxel = 1.0 / *values.cells_per_mm;
  if (!values.move_mm.empty()) change.translate_mm = VectorOf(values.move_mm);
  if (!values.facing.face.empty()) change.facing = values.facing;
  if (has_turn) {
    change.rotate = ParseTurn(values.turn_deg);
    if (!change.rotate) {
      throw arguments::UsageError(fmt::format(
          "--turn-deg cannot be '{}': give an axis and degrees, as in y,90", values.turn_deg));
    }
  }
  return change;
}

bool IsAny(const client::PlacementChange& c) {
  return c.reset || c.center_mm || c.rotation || c.device_mm_per_volume_mm ||
         c.device_mm_per_voxel || c.translate_mm || c.rotate || c.scale_by || c.facing;
}

void Print(const client::Placement& placement, std::uint64_t settings_revision, bool replayed,
           std::optional<std::uint64_t> applied_tick, bool json) {
  if (!json) {
    const std::string since =
        applied_tick ? fmt::format("applied at tick {}, ", *applied_tick) : "";
    WriteOutput(Describe(placement) + fmt::format("          {}settings revision {}{}\n", since,
                                                  settings_revision, OfReplay(replayed)));
    return;
  }
  Json object = PlacementJson(placement);
  object["settings_revision"] = settings_revision;
  object["replayed"] = replayed;
  if (applied_tick) object["applied_tick"] = *applied_tick;
  WriteOutput(ToText(object));
}

}  // namespace

void AddPlace(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "place",
      "Shows the volume's place in the device's workspace, or changes it at one tick.\n"
      "The device's axes: mm, x right, y up, z towards the user. Changes are applied in\n"
      "this order: --reset, absolute, relative. The daemon keeps the place for this volume.");
  SetFooter(*command,
            "Examples: palpate place --json\n"
            "          palpate place --move-mm 10,0,0 --turn-deg y,90\n"
            "          palpate place --reset --cells-per-mm 2\n"
            "          palpate place --face=-y --head=+z");
  const auto values = std::make_shared<PlaceValues>();
  AddAbsolute(*command, *values);
  AddRelative(*command, *values);
  AddFacing(*command, *values);
  command->add_option("--expected-revision", values->change.expected_revision,
                      "Change it only on top of this settings revision, else exit with 7");
  AddJson(*command, invocation);
  command->callback([command, &invocation, values] {
    const bool has_turn = command->get_option("--turn-deg")->count() > 0;
    const client::PlacementChange change = ChangeOf(*values, has_turn);
    if (change.expected_revision && !IsAny(change)) {
      throw arguments::UsageError("--expected-revision is for a change: name one");
    }
    invocation.command = [change, &invocation](client::Calls& palpated) {
      if (!IsAny(change)) {
        const client::PlacementNow now = palpated.GetPlacement();
        return Print(now.registration, now.settings_revision, now.replayed, std::nullopt,
                     invocation.json);
      }
      const client::PlacementResult result = palpated.Place(change);
      PrintNotKept(result.not_kept);
      Print(result.registration, result.settings_revision, false, result.applied_tick,
            invocation.json);
      const std::string tip = TipInWords(palpated, palpated.GetSettings());
      if (!tip.empty() && !invocation.json) WriteOutput(tip + "\n");
    };
  });
}

std::string Describe(const client::Placement& placement) {
  const Vec3& center = placement.center_mm;
  return fmt::format(
      "place     centre at {}, {}, {} mm of the device; {}\n"
      "          {} mm of the device per mm of the volume, {} per voxel: 1 mm is {:.6g} cells\n",
      NumberText(center.x()), NumberText(center.y()), NumberText(center.z()),
      DescribeTurn(placement.rotation), NumberText(placement.device_mm_per_volume_mm),
      NumberText(placement.device_mm_per_voxel), 1.0 / placement.device_mm_per_voxel);
}

Json PlacementJson(const client::Placement& placement) {
  const client::UnalignedQuaternion& q = placement.rotation;
  return {{"center_mm", ToJson(placement.center_mm)},
          {"rotation_wxyz", {q.w(), q.x(), q.y(), q.z()}},
          {"device_mm_per_volume_mm", placement.device_mm_per_volume_mm},
          {"device_mm_per_voxel", placement.device_mm_per_voxel}};
}

std::optional<client::UnalignedQuaternion> ParseTurn(std::string_view text) {
  constexpr std::string_view kAxes = "xyz";
  if (text.size() < 3 || text[1] != ',' || kAxes.find(text[0]) == kAxes.npos) return std::nullopt;
  std::string_view number = text.substr(2);
  if (number.size() > 1 && number[0] == '+' && number[1] != '-') number.remove_prefix(1);
  double degrees = 0.0;
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), degrees);
  if (error != std::errc() || end != number.data() + number.size() || !std::isfinite(degrees)) {
    return std::nullopt;
  }
  // Remove whole turns first: a huge angle would lose all its digits. More than half a turn becomes
  // a smaller turn in the other direction.
  const double half_rad = std::remainder(degrees, 360.0) / kDegreesPerRad / 2.0;
  client::UnalignedQuaternion rotation(std::cos(half_rad), 0.0, 0.0, 0.0);
  rotation.vec()[static_cast<Eigen::Index>(kAxes.find(text[0]))] = std::sin(half_rad);
  return rotation;
}

Vec3 PatientPlace(const std::string& text) {
  std::istringstream in(text.ends_with(" mm") ? text.substr(0, text.size() - 3) : text);
  const std::vector<std::string> words{std::istream_iterator<std::string>(in), {}};
  Vec3 p_P = Vec3::Constant(std::nan(""));
  for (std::size_t n = 0; n + 1 < words.size() && words.size() == 6; n += 2) {
    const auto mm = arguments::FiniteNumber(words[n + 1]);
    for (int axis = 0; axis < 3; ++axis) {
      const std::size_t sign = kPatientLetters[static_cast<std::size_t>(axis)].find(words[n]);
      if (words[n].size() == 1 && sign != std::string_view::npos && mm)
        p_P[axis] = sign == 0 ? *mm : -*mm;
    }
  }
  if (p_P.allFinite()) return p_P;
  throw arguments::UsageError("'" + text +
                              "' is no place in the patient: give one as viewers show "
                              "it, such as \"R 60 A 97 S 12\"");
}

Vec3 WorldOf(const Vec3& p_P, const std::string& axes) {
  if (axes.size() != 3) {
    throw Error(ErrorKind::kFailedPrecondition,
                "the file states no orientation: answer where the patient faces, as in 'palpate "
                "place --face=-y --head=+z', or give a place by --...-mm");
  }
  Vec3 p_W;
  for (int world = 0; world < 3; ++world) {
    const char letter = axes[static_cast<std::size_t>(world)];
    for (int axis = 0; axis < 3; ++axis) {
      const std::string_view letters = kPatientLetters[static_cast<std::size_t>(axis)];
      if (letters.find(letter) == letters.npos) continue;
      p_W[world] = letters.front() == letter ? p_P[axis] : -p_P[axis];
    }
  }
  return p_W;
}

}  // namespace palpate::cli
