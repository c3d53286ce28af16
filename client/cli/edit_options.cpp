#include "client/cli/edit_options.h"

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/edit_command.h"

namespace palpate::cli {
namespace {

using Numbers = std::vector<double>;

v1::Vector3 ToVector(const Numbers& numbers) {
  v1::Vector3 vector;
  vector.set_x(numbers[0]);
  vector.set_y(numbers[1]);
  vector.set_z(numbers[2]);
  return vector;
}

// Positions and lengths of a shape, each as --NAME-mm or as --NAME-voxels: the unit
// says the frame, and all must agree.
template <class Request>
class FrameOptions {
 public:
  using Store = std::function<void(Request&, const Numbers&)>;

  explicit FrameOptions(arguments::Command& command) : command_(command) {}

  void AddPosition(const std::string& name, const std::string& about, Store store) {
    Add(name, about, 3, "X,Y,Z", true, std::move(store));
  }
  void AddLength(const std::string& name, const std::string& about, bool required, Store store) {
    Add(name, about, 1, "LENGTH", required, std::move(store));
  }
  // A whole shape; no two of them at once.
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

  void Fill(Request& request) const {
    bool in_mm = false, in_voxels = false;
    for (const auto& option : options_) {
      in_mm |= option->mm->count() > 0;
      in_voxels |= option->voxels->count() > 0;
      if (option->required && option->mm->count() + option->voxels->count() == 0) {
        throw arguments::UsageError("--" + option->name + "-mm or --" + option->name +
                                    "-voxels is required");
      }
    }
    if (in_mm && in_voxels) {
      throw arguments::UsageError("give all positions and lengths in mm, or all in voxels");
    }
    request.set_frame(in_mm ? v1::EDIT_FRAME_WORLD : v1::EDIT_FRAME_INDEX);
    for (const auto& option : options_) {
      if (!option->values.empty()) option->store(request, option->values);
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
  };

  void Add(const std::string& name, const std::string& about, int count,
           const std::string& option_text, bool required, Store store) {
    auto option =
        std::make_unique<Option>(Option{name, required, std::move(store), {}, nullptr, nullptr});
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

using EditFrameOptions = FrameOptions<v1::EditVolumeRequest>;

// What the command line says of an edit; lives as long as its command.
struct EditValues {
  explicit EditValues(arguments::Command& command) : frame(command) {}

  v1::EditVolumeRequest request;
  EditFrameOptions frame;
  std::string operation;
  std::optional<double> value;
  std::optional<double> strength;
  std::optional<std::uint64_t> expected_revision;
  bool json = false;
};
using EditValuesPtr = std::shared_ptr<EditValues>;

const std::map<std::string, v1::EditOperation> kOperations = {
    {"add", v1::EDIT_OPERATION_ADD},     {"subtract", v1::EDIT_OPERATION_SUBTRACT},
    {"set", v1::EDIT_OPERATION_SET},     {"smooth", v1::EDIT_OPERATION_SMOOTH},
    {"paint", v1::EDIT_OPERATION_PAINT},
};

void AddCommon(arguments::Command& command, std::optional<std::uint64_t>& expected_revision,
               bool& json) {
  command.add_option("--expected-revision", expected_revision,
                     "Change it only on top of this volume revision, else exit with 7");
  command.add_flag("--json", json, "One JSON object instead of text");
}

// Options that all shapes share. `is_block`: has its own values.
void AddOperation(arguments::Command& command, EditValues& values, bool is_block) {
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
      .add_option("--strength", values.strength,
                  "For paint" + std::string(is_block ? "" : " and smooth") +
                      ": share of the way, above 0, up to 1 [default: 1]")
      ->check(arguments::Positive(1.0));
  AddCommon(command, values.expected_revision, values.json);
}

v1::EditVolumeRequest RequestOf(const EditValues& values) {
  v1::EditVolumeRequest request = values.request;
  request.set_operation(kOperations.at(values.operation));
  const bool needs_value = !request.has_block() && values.operation != "smooth";
  if (needs_value != values.value.has_value()) {
    throw arguments::UsageError(needs_value ? "--value is required for " + values.operation
                                            : "--value is not for smooth");
  }
  if (values.value) request.set_value(*values.value);
  if (values.strength) request.set_strength(*values.strength);
  if (values.expected_revision) request.set_expected_revision(*values.expected_revision);
  return request;
}

void AddShape(arguments::Command& edit, Invocation& invocation, const std::string& name,
              const std::string& about, const std::string& example,
              const std::function<void(EditFrameOptions&)>& add) {
  arguments::Command* command = edit.add_subcommand(name, about);
  SetFooter(*command, example);
  const auto values = std::make_shared<EditValues>(*command);
  add(values->frame);
  values->frame.AddLength("falloff",
                          "Over which the effect fades outside of the shape [default: 0]", false,
                          [](v1::EditVolumeRequest& r, const Numbers& n) { r.set_falloff(n[0]); });
  AddOperation(*command, *values, /*is_block=*/false);
  command->callback([&invocation, values] {
    values->frame.Fill(values->request);
    invocation.command = [request = RequestOf(*values), json = values->json](const Connection& c) {
      EditVolume(c, request, json);
    };
  });
}

void AddSphere(arguments::Command& edit, Invocation& invocation) {
  AddShape(edit, invocation, "sphere", "Changes the voxels of a sphere",
           "Examples: palpate edit sphere --center-mm 12,-3,40 --radius-mm 5 --operation set "
           "--value 0\n"
           "          palpate edit sphere --center-voxels 64,64,64 --radius-voxels 8 \\\n"
           "              --falloff-voxels 4 --operation smooth --strength 0.5",
           [](EditFrameOptions& frame) {
             frame.AddPosition("center", "Centre", [](auto& r, const Numbers& n) {
               *r.mutable_sphere()->mutable_center() = ToVector(n);
             });
             frame.AddLength("radius", "Radius", true, [](auto& r, const Numbers& n) {
               r.mutable_sphere()->set_radius(n[0]);
             });
           });
}

void AddBox(arguments::Command& edit, Invocation& invocation) {
  AddShape(edit, invocation, "box", "Changes the voxels of a box, its corners included",
           "Example: palpate edit box --min-voxels 0,0,0 --max-voxels 31,63,63 --operation add "
           "--value 20",
           [](EditFrameOptions& frame) {
             frame.AddPosition("min", "Least corner", [](auto& r, const Numbers& n) {
               *r.mutable_box()->mutable_min() = ToVector(n);
             });
             frame.AddPosition("max", "Greatest corner", [](auto& r, const Numbers& n) {
               *r.mutable_box()->mutable_max() = ToVector(n);
             });
           });
}

void AddCapsule(arguments::Command& edit, Invocation& invocation) {
  AddShape(edit, invocation, "capsule", "Changes the voxels that a sphere sweeps: a stroke",
           "Example: palpate edit capsule --from-mm 0,0,0 --to-mm 10,0,0 --radius-mm 2 \\\n"
           "             --operation subtract --value 300",
           [](EditFrameOptions& frame) {
             frame.AddPosition("from", "Where the sphere starts", [](auto& r, const Numbers& n) {
               *r.mutable_capsule()->mutable_from() = ToVector(n);
             });
             frame.AddPosition("to", "Where it ends", [](auto& r, const Numbers& n) {
               *r.mutable_capsule()->mutable_to() = ToVector(n);
             });
             frame.AddLength("radius", "Radius", true, [](auto& r, const Numbers& n) {
               r.mutable_capsule()->set_radius(n[0]);
             });
           });
}

// Where the options of `edit block` put their values.
struct BlockValues {
  explicit BlockValues(arguments::Command& command) : edit(command) {}
  EditValues edit;
  std::string file;
  std::vector<std::uint32_t> min, size;
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
  const auto add = [&](const char* name, std::vector<std::uint32_t>& target, const char* about) {
    command->add_option(name, target, about)
        ->delimiter(',')
        ->expected(3)
        ->required()
        ->option_text("X,Y,Z");
  };
  add("--min-voxels", values->min, "First voxel of the block");
  add("--size-voxels", values->size, "Voxels along x, y, z");
  AddOperation(*command, values->edit, /*is_block=*/true);
  command->callback([&invocation, values] {
    v1::DenseBlock& block = *values->edit.request.mutable_block();
    block.set_min_x(values->min[0]);
    block.set_min_y(values->min[1]);
    block.set_min_z(values->min[2]);
    block.set_size_x(values->size[0]);
    block.set_size_y(values->size[1]);
    block.set_size_z(values->size[2]);
    values->edit.request.set_frame(v1::EDIT_FRAME_INDEX);
    invocation.command = [values, request = RequestOf(values->edit)](const Connection& c) mutable {
      request.mutable_block()->set_values(ReadBlockValues(values->file));
      EditVolume(c, request, values->edit.json);
    };
  });
}

const std::map<std::string, v1::FilterKind> kFilterKinds = {
    {"gaussian", v1::FILTER_KIND_GAUSSIAN},
    {"mean", v1::FILTER_KIND_MEAN},
    {"median", v1::FILTER_KIND_MEDIAN},
    {"offset", v1::FILTER_KIND_OFFSET},
    {"mean-curvature", v1::FILTER_KIND_MEAN_CURVATURE},
    {"resample", v1::FILTER_KIND_RESAMPLE},
};

// What the command line says of a filter; lives as long as its command.
struct FilterValues {
  explicit FilterValues(arguments::Command& command) : frame(command) {}

  v1::FilterVolumeRequest request;
  FrameOptions<v1::FilterVolumeRequest> frame;
  std::string kind;
  std::uint32_t width = 1;
  std::uint32_t iterations = 1;
  std::optional<double> distance_mm;
  Numbers spacing_mm;
  std::optional<std::uint64_t> expected_revision;
  bool json = false;
};

void AddRegion(FilterValues& values) {
  values.frame.AddShape("box", "Only the voxels of a box: least and greatest corner", 6,
                        "X,Y,Z,X,Y,Z", [](auto& r, const Numbers& n) {
                          *r.mutable_box()->mutable_min() = ToVector({n[0], n[1], n[2]});
                          *r.mutable_box()->mutable_max() = ToVector({n[3], n[4], n[5]});
                        });
  values.frame.AddShape("sphere", "Only the voxels of a sphere: centre and radius", 4, "X,Y,Z,R",
                        [](auto& r, const Numbers& n) {
                          *r.mutable_sphere()->mutable_center() = ToVector({n[0], n[1], n[2]});
                          r.mutable_sphere()->set_radius(n[3]);
                        });
}

void AddKind(arguments::Command& command, FilterValues& values) {
  command
      .add_option("--kind", values.kind,
                  "gaussian (four means), mean (of the (2 width + 1)^3 voxels around),\n"
                  "median (of the same voxels; slow); of a level set: offset (moves the\n"
                  "surface) and mean-curvature (smooths it); resample (to another spacing)")
      ->required()
      ->check(arguments::IsMember(
          {"gaussian", "mean", "median", "offset", "mean-curvature", "resample"}))
      ->option_text("KIND");
  command
      .add_option("--width", values.width,
                  "Of gaussian, mean and median, in voxels, 1 to 8; more is smoother\n"
                  "[default: 1]")
      ->option_text("N");
  command
      .add_option("--iterations", values.iterations,
                  "How often; width times iterations is at most 8 for gaussian, 32 for mean\n"
                  "and median [default: 1]")
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

v1::FilterVolumeRequest RequestOf(FilterValues& values) {
  v1::FilterVolumeRequest& request = values.request;
  request.set_kind(kFilterKinds.at(values.kind));
  request.set_width(values.width);
  request.set_iterations(values.iterations);
  if (values.expected_revision) request.set_expected_revision(*values.expected_revision);
  if (values.distance_mm.has_value() != (values.kind == "offset")) {
    throw arguments::UsageError("--distance-mm is for --kind offset, which needs it");
  }
  if (values.spacing_mm.empty() == (values.kind == "resample")) {
    throw arguments::UsageError("--spacing-mm is for --kind resample, which needs it");
  }
  if (values.distance_mm) request.set_distance_mm(*values.distance_mm);
  if (values.spacing_mm.size() == 2) {
    throw arguments::UsageError("--spacing-mm: one number, or three: X,Y,Z");
  }
  if (values.spacing_mm.size() == 1) values.spacing_mm.resize(3, values.spacing_mm[0]);
  if (!values.spacing_mm.empty()) *request.mutable_spacing_mm() = ToVector(values.spacing_mm);
  values.frame.Fill(request);
  return request;
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
  AddCommon(*command, values->expected_revision, values->json);
  command->callback([&invocation, values] {
    const v1::FilterVolumeRequest request = RequestOf(*values);
    invocation.command = [request, json = values->json](const Connection& c) {
      FilterVolume(c, request, json);
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

void AddHistory(arguments::Command& app, Invocation& invocation) {
  const auto add = [&](const char* name, const char* about, HistoryCommand what) {
    struct Values {
      std::optional<std::uint64_t> expected_revision;
      bool json = false;
    };
    arguments::Command* command = app.add_subcommand(name, about);
    SetFooter(*command, std::string("Example: palpate ") + name);
    const auto values = std::make_shared<Values>();
    AddCommon(*command, values->expected_revision, values->json);
    command->callback([&invocation, values, what] {
      invocation.command = [values, what](const Connection& c) {
        MoveInHistory(c, what, values->expected_revision, values->json);
      };
    });
  };
  add("undo", "Takes back the last edit", HistoryCommand::kUndo);
  add("redo", "Does again the edit that was taken back last", HistoryCommand::kRedo);
  add("revert", "Takes back all edits since the volume was loaded; undo takes that back",
      HistoryCommand::kRevert);
}

void AddSave(arguments::Command& app, Invocation& invocation) {
  struct Values {
    std::string path;
    bool overwrite = false;
    bool json = false;
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
  command->add_flag("--json", values->json, "One JSON object instead of text");
  command->callback([&invocation, values] {
    v1::SaveVolumeRequest request;
    request.set_path(values->path);
    request.set_overwrite(values->overwrite);
    invocation.command = [request, json = values->json](const Connection& c) {
      SaveVolume(c, request, json);
    };
  });
}

}  // namespace palpate::cli
