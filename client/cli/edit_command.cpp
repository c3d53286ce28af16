// `palpate edit`, and `palpate undo`, `redo`, `revert` and `save`.
#include <fmt/core.h>

#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/paths_there.h"
#include "client/cli/place_command.h"
#include "client/sdk/edit.h"
#include "common/error/error.h"
#include "common/error/text.h"
#include "common/wire/limits.h"

namespace palpate::cli {
namespace {

// Returns text such as "515 voxels changed within 15 15 15 to 25 25 25, applied at tick 123, volume
// revision 7; 1 to undo, 0 to redo".
std::string DescribeEdit(const client::EditResult& result) {
  std::string what = "no voxel changed";
  if (result.changed) {
    const client::IndexBox& box = *result.changed;
    what = fmt::format("{} voxel{} changed within {} {} {} to {} {} {}", result.changed_voxels,
                       result.changed_voxels == 1 ? "" : "s", box.min.x(), box.min.y(), box.min.z(),
                       box.max.x(), box.max.y(), box.max.z());
  }
  return fmt::format("{}, applied at tick {}, volume revision {}; {} to undo, {} to redo", what,
                     result.applied_tick, result.volume_revision, result.undo_steps,
                     result.redo_steps);
}

void PrintEdit(const client::EditResult& result, bool json) {
  WriteOutput(json ? ToText(ToJson(result)) : DescribeEdit(result) + "\n");
}

// Reads the values of a block: raw float32, little-endian, from `file`, or from stdin for "-".
// Errors: kNotFound, kTooLarge (more than a block may have), kInvalidArgument (not a whole number
// of values).
std::vector<float> ReadBlockValues(const std::string& file) {
  const auto close = [](std::FILE* f) {
    if (f != stdin) std::fclose(f);
  };
  const std::unique_ptr<std::FILE, decltype(close)> in(
      file == "-" ? stdin : std::fopen(file.c_str(), "rb"), close);
  if (!in) throw Error(ErrorKind::kNotFound, file + ": there is no such file that can be read");
  const std::string name = file == "-" ? "stdin" : file;
  std::string bytes(kMostBlockBytes + 1, '\0');
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), in.get()));
  if (std::ferror(in.get())) throw Error(ErrorKind::kInvalidArgument, name + ": cannot be read");
  if (bytes.size() > kMostBlockBytes) {
    throw Error(ErrorKind::kTooLarge,
                name + ": a block has at most 3 MiB of values: send it in parts");
  }
  std::vector<float> values(bytes.size() / sizeof(float));
  if (values.size() * sizeof(float) != bytes.size()) {
    throw Error(ErrorKind::kInvalidArgument, name + ": its bytes are no whole number of float32");
  }
  std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

using Numbers = std::vector<double>;

// Positions and lengths of a shape, each as --NAME-mm or as --NAME-voxels; positions also by the
// patient's letters, as --NAME-patient. The unit selects the frame; all must have the same unit.
template <class Change>
class FrameOptions {
 public:
  using Store = std::function<void(Change&, const Numbers&)>;

  explicit FrameOptions(arguments::Command& command) : command_(command) {}

  void AddPosition(const std::string& name, const std::string& about, Store store) {
    Add(name, about, 3, "X,Y,Z", true, std::move(store));
    Option& option = *options_.back();
    option.patient = command_
                         .add_option("--" + name + "-patient", option.place,
                                     "The same as viewers show it: \"R 60 A 97 S 12\"")
                         ->excludes(option.mm)
                         ->excludes(option.voxels)
                         ->option_text("PLACE");
  }
  void AddLength(const std::string& name, const std::string& about, bool required, Store store) {
    Add(name, about, 1, "LENGTH", required, std::move(store));
  }
  // Adds a whole shape as one option. At most one such option may be given.
  void AddShape(const std::string& name, const std::string& about, int count,
                const std::string& text, Store store) {
    Add(name, about, count, text, false, std::move(store));
    const Option& added = *options_.back();
    for (std::size_t n = 0; n + 1 < options_.size(); ++n) {
      for (arguments::Option* other : {options_[n]->mm, options_[n]->voxels}) {
        added.mm->excludes(other);
        added.voxels->excludes(other);
      }
    }
  }

  void Fill(Change& change) const {
    bool in_mm = false, in_voxels = false;
    for (const auto& option : options_) {
      const bool has_place = option->patient && option->patient->count() > 0;
      if (has_place) option->patient_mm = PatientPlace(option->place);
      in_mm |= has_place || option->mm->count() > 0;
      in_voxels |= option->voxels->count() > 0;
      if (option->required && !has_place && option->mm->count() + option->voxels->count() == 0) {
        throw arguments::UsageError("--" + option->name + "-mm or --" + option->name +
                                    "-voxels is required");
      }
    }
    if (in_mm && in_voxels) {
      throw arguments::UsageError("give all positions and lengths in mm, or all in voxels");
    }
    change.frame = in_mm ? client::EditFrame::kWorld : client::EditFrame::kIndex;
    for (const auto& option : options_) {
      if (!option->values.empty()) option->store(change, option->values);
    }
  }
  // After Fill: the places that need to know how the patient lies.
  void Place(Change& change, client::Calls& palpated) const {
    for (const auto& option : options_) {
      if (!option->patient_mm) continue;
      const Vec3 p_W = WorldOf(*option->patient_mm, palpated.GetVolume().patient_axes);
      option->store(change, {p_W.x(), p_W.y(), p_W.z()});
    }
  }

 private:
  struct Option {
    std::string name;
    bool required;
    Store store;
    Numbers values;
    arguments::Option* mm;
    arguments::Option* voxels;
    arguments::Option* patient = nullptr;  // of a position
    std::string place{};
    std::optional<Vec3> patient_mm{};
  };

  void Add(const std::string& name, const std::string& about, int count,
           const std::string& option_text, bool required, Store store) {
    auto option = std::make_unique<Option>(
        Option{name, required, std::move(store), {}, nullptr, nullptr, nullptr, {}, {}});
    const auto add = [&](const char* unit, const std::string& text) {
      return command_.add_option("--" + name + unit, option->values, text)
          ->delimiter(',')
          ->expected(count)
          ->check(arguments::Finite())
          ->option_text(option_text);
    };
    option->mm = add("-mm", about + (count == 1 ? ", in mm" : ", in mm (LPS as in DICOM)"));
    option->voxels = add("-voxels", "The same in voxels")->excludes(option->mm);
    options_.push_back(std::move(option));
  }

  arguments::Command& command_;
  std::vector<std::unique_ptr<Option>> options_;
};

using EditFrameOptions = FrameOptions<client::Edit>;

// The values of an edit's options. Lives as long as its command.
struct EditValues {
  explicit EditValues(arguments::Command& command) : frame(command) {}

  client::Edit edit;
  EditFrameOptions frame;
  std::string operation;
  std::optional<double> value;
};
using EditValuesPtr = std::shared_ptr<EditValues>;

void AddCommon(arguments::Command& command, Invocation& invocation,
               std::optional<std::uint64_t>& expected_revision) {
  command.add_option("--expected-revision", expected_revision,
                     "Change it only on top of this volume revision, else exit with 7");
  AddJson(command, invocation);
}

// Options that all shapes share. `is_block`: a block has its own values.
void AddOperation(arguments::Command& command, Invocation& invocation, EditValues& values,
                  bool is_block) {
  std::vector<std::string> names = {"add", "subtract", "set", "paint"};
  if (!is_block) names.push_back("smooth");
  command
      .add_option("--operation", values.operation,
                  "add, subtract, set, paint (part of the way to the value)" +
                      std::string(is_block ? "" : ",\nsmooth (towards the voxels around)"))
      ->required()
      ->check(arguments::IsMember(names))
      ->option_text("OPERATION");
  if (!is_block) {
    command.add_option("--value", values.value, "In data units; all but smooth need it")
        ->check(arguments::Finite());
  }
  command
      .add_option("--strength", values.edit.strength,
                  "For paint" + std::string(is_block ? "" : " and smooth") +
                      ": share of the way, above 0, up to 1 [default: 1]")
      ->check(arguments::Positive(1.0));
  AddCommon(command, invocation, values.edit.expected_revision);
}

void CheckOperation(EditValues& values, bool is_block) {
  values.edit.operation = *Named<EditOperation>(values.operation);
  const bool needs_value = !is_block && values.operation != "smooth";
  if (needs_value != values.value.has_value()) {
    throw arguments::UsageError(needs_value ? "--value is required for " + values.operation
                                            : "--value is not for smooth");
  }
  values.edit.value = values.value.value_or(0.0);
}

// `add` describes the positions and lengths of a shape and stores them in `edit.shape`.
void AddShape(arguments::Command& edit, Invocation& invocation, const std::string& name,
              const std::string& about, const std::string& example,
              const std::function<void(EditFrameOptions&)>& add) {
  arguments::Command* command = edit.add_subcommand(name, about);
  SetFooter(*command, example);
  const auto values = std::make_shared<EditValues>(*command);
  add(values->frame);
  values->frame.AddLength("falloff",
                          "Over which the effect fades outside of the shape [default: 0]", false,
                          [](client::Edit& e, const Numbers& n) { e.falloff = n[0]; });
  AddOperation(*command, invocation, *values, /*is_block=*/false);
  command->callback([&invocation, values] {
    values->frame.Fill(values->edit);
    CheckOperation(*values, /*is_block=*/false);
    invocation.command = [values, &invocation](client::Calls& palpated) {
      values->frame.Place(values->edit, palpated);
      PrintEdit(WithProgress(
                    [&](const auto& progress) { return palpated.Apply(values->edit, progress); }),
                invocation.json);
    };
  });
}

// Returns the edit's shape. Sets it first if the edit has none of this type.
template <class Shape>
Shape& As(client::Edit& edit) {
  if (!std::holds_alternative<Shape>(edit.shape)) edit.shape = Shape();
  return std::get<Shape>(edit.shape);
}

void AddSphere(arguments::Command& edit, Invocation& invocation) {
  AddShape(edit, invocation, "sphere", "Changes the voxels of a sphere",
           "Examples: palpate edit sphere --center-mm 12,-3,40 --radius-mm 5 --operation set "
           "--value 0\n"
           "          palpate edit sphere --center-patient \"R 60 A 97 S 12\" --radius-mm 5 \\\n"
           "              --operation smooth\n"
           "          palpate edit sphere --center-voxels 64,64,64 --radius-voxels 8 \\\n"
           "              --falloff-voxels 4 --operation smooth --strength 0.5",
           [](EditFrameOptions& frame) {
             frame.AddPosition("center", "Centre", [](auto& e, const Numbers& n) {
               As<client::Sphere>(e).center = VectorOf(n);
             });
             frame.AddLength("radius", "Radius", true, [](auto& e, const Numbers& n) {
               As<client::Sphere>(e).radius = n[0];
             });
           });
}

void AddBox(arguments::Command& edit, Invocation& invocation) {
  AddShape(edit, invocation, "box", "Changes the voxels of a box, its corners included",
           "Example: palpate edit box --min-voxels 0,0,0 --max-voxels 31,63,63 --operation add "
           "--value 20",
           [](EditFrameOptions& frame) {
             frame.AddPosition("min", "Least corner", [](auto& e, const Numbers& n) {
               As<client::Box>(e).min = VectorOf(n);
             });
             frame.AddPosition("max", "Greatest corner", [](auto& e, const Numbers& n) {
               As<client::Box>(e).max = VectorOf(n);
             });
           });
}

void AddCapsule(arguments::Command& edit, Invocation& invocation) {
  AddShape(edit, invocation, "capsule", "Changes the voxels that a sphere sweeps: a stroke",
           "Example: palpate edit capsule --from-mm 0,0,0 --to-mm 10,0,0 --radius-mm 2 \\\n"
           "             --operation subtract --value 300",
           [](EditFrameOptions& frame) {
             frame.AddPosition("from", "Where the sphere starts", [](auto& e, const Numbers& n) {
               As<client::Capsule>(e).from = VectorOf(n);
             });
             frame.AddPosition("to", "Where it ends", [](auto& e, const Numbers& n) {
               As<client::Capsule>(e).to = VectorOf(n);
             });
             frame.AddLength("radius", "Radius", true, [](auto& e, const Numbers& n) {
               As<client::Capsule>(e).radius = n[0];
             });
           });
}

// The values of `edit block`'s options.
struct BlockValues {
  explicit BlockValues(arguments::Command& command) : edit(command) {}
  EditValues edit;
  std::string file;
  std::vector<int> min, size;
};

void AddBlock(arguments::Command& edit, Invocation& invocation) {
  arguments::Command* command = edit.add_subcommand(
      "block", "Changes a block of voxels, each by a value of its own, at most 3 MiB of them");
  SetFooter(*command,
            "Example: palpate edit block values.f32 --min-voxels 10,10,10 --size-voxels 32,32,32 "
            "\\\n             --operation set");
  const auto values = std::make_shared<BlockValues>(*command);
  command
      ->add_option("file", values->file,
                   "Raw float32 values, little-endian, x fastest; -: from stdin")
      ->required()
      ->option_text("FILE");
  const auto add = [&](const char* name, std::vector<int>& target, const char* about) {
    command->add_option(name, target, about)
        ->delimiter(',')
        ->expected(3)
        ->check(arguments::Range(0, std::numeric_limits<int>::max()))
        ->required()
        ->option_text("X,Y,Z");
  };
  add("--min-voxels", values->min, "First voxel of the block");
  add("--size-voxels", values->size, "Voxels along x, y, z");
  AddOperation(*command, invocation, values->edit, /*is_block=*/true);
  command->callback([&invocation, values] {
    CheckOperation(values->edit, /*is_block=*/true);
    values->edit.edit.frame = client::EditFrame::kIndex;
    invocation.command = [values, &invocation](client::Calls& palpated) {
      client::Edit& change = values->edit.edit;
      change.shape = client::Block{Vec3i(values->min.data()), Vec3i(values->size.data()),
                                   ReadBlockValues(values->file)};
      PrintEdit(palpated.Apply(change), invocation.json);
    };
  });
}

// The values of a filter's options. Lives as long as its command.
struct FilterValues {
  explicit FilterValues(arguments::Command& command) : frame(command) {}

  client::Filter filter;
  FrameOptions<client::Filter> frame;
  std::string kind;
  std::optional<double> distance_mm;
  Numbers spacing_mm;
};

void AddRegion(FilterValues& values) {
  values.frame.AddShape("box", "Only the voxels of a box: least and greatest corner", 6,
                        "X,Y,Z,X,Y,Z", [](client::Filter& f, const Numbers& n) {
                          f.region = client::Box{{n[0], n[1], n[2]}, {n[3], n[4], n[5]}};
                        });
  values.frame.AddShape("sphere", "Only the voxels of a sphere: centre and radius", 4, "X,Y,Z,R",
                        [](client::Filter& f, const Numbers& n) {
                          f.region = client::Sphere{{n[0], n[1], n[2]}, n[3]};
                        });
}

void AddKind(arguments::Command& command, FilterValues& values) {
  const arguments::Validator count = arguments::Range(0, std::numeric_limits<int>::max());
  command
      .add_option("--kind", values.kind,
                  "gaussian (four means), mean (of the (2 width + 1)^3 voxels around),\n"
                  "median (of the same voxels; slow); of a level set: offset (moves the\n"
                  "surface) and mean-curvature (smooths it); resample (to another spacing)")
      ->required()
      ->check(arguments::IsMember({kWords<FilterKind>.begin(), kWords<FilterKind>.end()}))
      ->option_text("KIND");
  command
      .add_option("--width", values.filter.width,
                  "Of gaussian, mean and median, in voxels, 1 to 8; more is smoother\n"
                  "[default: 1]")
      ->check(count)
      ->option_text("N");
  command
      .add_option("--iterations", values.filter.iterations,
                  "How often; width times iterations is at most 8 for gaussian, 32 for mean\n"
                  "and median [default: 1]")
      ->check(count)
      ->option_text("N");
  arguments::Option* const distance =
      command
          .add_option("--distance-mm", values.distance_mm,
                      "Of offset: how far outwards; inwards where negative")
          ->check(arguments::Finite())
          ->option_text("MM");
  command
      .add_option("--spacing-mm", values.spacing_mm,
                  "Of resample: the new spacing, one number or X,Y,Z")
      ->delimiter(',')
      ->expected(1, 3)
      ->check(arguments::Positive())
      ->excludes(distance)
      ->option_text("MM");
}

void Fill(FilterValues& values) {
  client::Filter& filter = values.filter;
  filter.kind = *Named<FilterKind>(values.kind);
  if (values.distance_mm.has_value() != (values.kind == "offset")) {
    throw arguments::UsageError("--distance-mm is for --kind offset, which needs it");
  }
  if (values.spacing_mm.empty() == (values.kind == "resample")) {
    throw arguments::UsageError("--spacing-mm is for --kind resample, which needs it");
  }
  filter.distance_mm = values.distance_mm.value_or(0.0);
  if (values.spacing_mm.size() == 2) {
    throw arguments::UsageError("--spacing-mm: one number, or three: X,Y,Z");
  }
  if (values.spacing_mm.size() == 1) values.spacing_mm.resize(3, values.spacing_mm[0]);
  if (!values.spacing_mm.empty()) filter.spacing_mm = VectorOf(values.spacing_mm);
  values.frame.Fill(filter);
}

void AddFilter(arguments::Command& edit, Invocation& invocation) {
  arguments::Command* command = edit.add_subcommand(
      "filter",
      "Filters all voxels, or those of a box or a sphere, with a filter of OpenVDB, as one edit.\n"
      "Edits of others go on meanwhile, and are filtered too. Ctrl-C cancels, with exit code 9.\n"
      "offset, mean-curvature and resample are for the whole volume.");
  SetFooter(*command,
            "Examples: palpate edit filter --kind gaussian\n"
            "          palpate edit filter --kind median --width 1 --sphere-voxels 64,64,64,20\n"
            "          palpate edit filter --kind resample --spacing-mm 0.5\n"
            "          palpate edit filter --kind offset --distance-mm -0.5");
  const auto values = std::make_shared<FilterValues>(*command);
  AddKind(*command, *values);
  AddRegion(*values);
  AddCommon(*command, invocation, values->filter.expected_revision);
  command->callback([&invocation, values] {
    Fill(*values);
    invocation.command = [values, &invocation](client::Calls& palpated) {
      PrintEdit(WithProgress([&](const auto& progress) {
                  return palpated.RunFilter(values->filter, progress);
                }),
                invocation.json);
    };
  });
}

}  // namespace

void AddEdit(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "edit",
      "Changes voxels, at one tick: within a shape, fading out over a falloff around it, or\n"
      "in a block; or filters them. What is felt is the new surface from then on; see also undo\n"
      "and revert.");
  SetFooter(*command, "Example: palpate edit sphere --help");
  command->require_subcommand(1);
  command->fallthrough();
  AddSphere(*command, invocation);
  AddBox(*command, invocation);
  AddCapsule(*command, invocation);
  AddBlock(*command, invocation);
  AddFilter(*command, invocation);
}

namespace {

void Save(client::Calls& palpated, const std::string& file, bool overwrite, bool json) {
  const std::string path = PathThere(palpated, file);
  const client::SaveResult result = WithProgress(
      [&](const auto& progress) { return palpated.SaveVolume(path, overwrite, progress); });
  if (json) {
    WriteOutput(ToText(Json{{"path", path},
                            {"volume_revision", result.volume_revision},
                            {"size_bytes", result.size_bytes}}));
    return;
  }
  WriteOutput(fmt::format("saved volume revision {} to {}, {:.1f} MiB\n", result.volume_revision,
                          OneLine(path),
                          static_cast<double>(result.size_bytes) / (1024.0 * 1024.0)));
}

}  // namespace

void AddHistory(arguments::Command& app, Invocation& invocation) {
  using Revision = std::optional<std::uint64_t>;
  const auto add = [&](const char* name, const char* about,
                       client::EditResult (client::Calls::*move)(Revision)) {
    arguments::Command* command = app.add_subcommand(name, about);
    SetFooter(*command, std::string("Example: palpate ") + name);
    const auto expected_revision = std::make_shared<Revision>();
    command->add_option("--expected-revision", *expected_revision,
                        "Change it only on top of this volume revision, else exit with 7");
    AddJson(*command, invocation);
    command->callback([&invocation, expected_revision, move] {
      invocation.command = [&invocation, expected_revision, move](client::Calls& palpated) {
        PrintEdit((palpated.*move)(*expected_revision), invocation.json);
      };
    });
  };
  add("undo", "Undoes the last edit", &client::Calls::Undo);
  add("redo", "Redoes the edit that was undone last", &client::Calls::Redo);
  add("revert", "Undoes all edits since the volume was loaded; undo restores them",
      &client::Calls::Revert);
}

void AddSave(arguments::Command& app, Invocation& invocation) {
  struct Values {
    std::string path;
    bool overwrite = false;
  };
  arguments::Command* command = app.add_subcommand(
      "save",
      "Writes the volume with its edits on the daemon's machine; the file is whole or as it was\n"
      "before. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command, "Example: palpate save carved.nrrd --overwrite");
  const auto values = std::make_shared<Values>();
  command->add_option("path", values->path, "File to write; ends with .vdb or .nrrd")
      ->required()
      ->option_text("PATH");
  command->add_flag("--overwrite", values->overwrite, "Replace a file that is there");
  AddJson(*command, invocation);
  command->callback([&invocation, values] {
    invocation.command = [values, &invocation](client::Calls& palpated) {
      Save(palpated, values->path, values->overwrite, invocation.json);
    };
  });
}

}  // namespace palpate::cli
