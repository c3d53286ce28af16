#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "client/cli/commands.h"
#include "client/cli/isovalues.h"
#include "client/cli/layers.h"
#include "client/cli/output.h"
#include "common/error/error.h"
#include "common/files/text_file.h"

namespace palpate::cli {
namespace {

constexpr std::size_t kMostLayersBytes = 256 << 10;  // of a file

struct LayersValues {
  std::string list;
  std::string load;
};

// Of palpate layer: absent numbers stay.
struct LayerValues {
  std::string name;
  std::string isovalue;
  std::optional<double> stiffness, damping, static_friction, sliding_friction, pop_n, pop_out_n,
      viscosity;
  std::string remove;
};

// A number, or the name of a suggested isovalue.
double IsovalueOf(client::Calls& palpated, const std::string& text) {
  if (const auto number = arguments::FiniteNumber(text)) return *number;
  return SuggestedIsovalueOf(palpated.GetVolume(), text);
}

void Print(const client::Settings& settings, bool json) {
  if (settings.replayed && !json) WriteOutput("of the replay:\n");
  WriteOutput(json ? ToJson(settings.layers).dump(2) + "\n" : Describe(settings.layers));
}

// `revision`: of the settings that the change is made from; none: whatever they are.
void Set(client::Calls& palpated, const SurfaceLayers& layers,
         const std::optional<std::uint64_t>& revision, bool json) {
  client::SettingsUpdate update;
  update.layers = layers;
  update.expected_revision = revision;
  const client::SettingsResult result = palpated.Set(update);
  PrintNotKept(result.not_kept);
  Print(result.settings, json);
  if (!json) WriteOutput(fmt::format("felt since tick {}\n", result.applied_tick));
}

void RunLayers(client::Calls& palpated, const LayersValues& values, bool json) {
  if (!values.load.empty()) {
    return Set(palpated, LayersOfJson(ReadTextFile(values.load, kMostLayersBytes)), std::nullopt,
               json);
  }
  if (values.list.empty()) return Print(palpated.GetSettings(), json);
  const auto isovalue_of = [&](const std::string& text) { return IsovalueOf(palpated, text); };
  Set(palpated, LayersOfList(values.list, isovalue_of), std::nullopt, json);
}

void Take(const LayerValues& values, SurfaceLayer& layer) {
  const auto take = [](const std::optional<double>& value, auto& member) {
    if (value) member = *value;
  };
  take(values.stiffness, layer.stiffness_n_per_mm);
  take(values.damping, layer.damping_n_s_per_m);
  take(values.static_friction, layer.static_friction);
  take(values.sliding_friction, layer.dynamic_friction);
  take(values.pop_n, layer.pop_force_n);
  take(values.pop_out_n, layer.pop_out_force_n);
  take(values.viscosity, layer.viscosity_n_s_per_m);
}

[[noreturn]] void RefuseName(const SurfaceLayers& layers, const std::string& name, bool adds) {
  std::string names;
  for (const SurfaceLayer& layer : layers.layer) {
    names += (names.empty() ? "" : ", ") + layer.name;
  }
  throw Error(ErrorKind::kNotFound, "there is no layer '" + name + "'" +
                                        (names.empty() ? "" : ": there are " + names) +
                                        (adds ? "; with --isovalue it is added" : ""));
}

void RunLayer(client::Calls& palpated, const LayerValues& values, bool json) {
  const client::Settings settings = palpated.GetSettings();
  SurfaceLayers layers = settings.layers;
  if (values.remove == "all") return Set(palpated, {}, std::nullopt, json);
  const std::string& name = values.remove.empty() ? values.name : values.remove;
  auto layer = std::ranges::find(layers.layer, name, &SurfaceLayer::name);
  if (layer == layers.layer.end()) {
    if (values.isovalue.empty()) RefuseName(layers, name, values.remove.empty());
    layers.layer.push_back(NewLayer(name, !values.pop_n || !(*values.pop_n > 0.0)));
    layer = layers.layer.end() - 1;
  }
  if (!values.remove.empty()) {
    layers.layer.erase(layer);
  } else {
    if (!values.isovalue.empty()) layer->isovalue = IsovalueOf(palpated, values.isovalue);
    Take(values, *layer);
  }
  Set(palpated, layers, settings.revision, json);
}

}  // namespace

void AddLayers(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command =
      app.add_subcommand("layers", "Shows or sets the surfaces that are felt one behind the other");
  SetFooter(*command,
            "LIST: NAME=ISOVALUE,... from outside inwards, or skin-bone (CT in HU). The last one\n"
            "holds; the others are soft, and the stylus passes them at 1 N. `palpate layer`\n"
            "changes one, and removes layers.\n"
            "Examples: palpate layers skin=-300,bone=300\n"
            "          palpate layers --json > my-layers.json\n"
            "          palpate layers --load my-layers.json");
  const auto values = std::make_shared<LayersValues>();
  arguments::Option* list =
      command->add_option("list", values->list, "The new layers, in place of those there are")
          ->option_text("LIST")
          ->suggest({"skin-bone"});
  command->add_option("--load", values->load, "Sets those of a file that --json has printed")
      ->option_text("FILE")
      ->excludes(list);
  AddJson(*command, invocation);
  command->callback([&invocation, values] {
    invocation.command = [values, &invocation](client::Calls& palpated) {
      RunLayers(palpated, *values, invocation.json);
    };
  });
}

void AddLayer(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command =
      app.add_subcommand("layer", "Adds, changes or removes one of the layers");
  SetFooter(*command,
            "What is not named stays. A new layer needs an isovalue.\n"
            "Examples: palpate layer skin --isovalue 150 --pop-n 1\n"
            "          palpate layer bone --stiffness 1.5\n"
            "          palpate layer --remove skin    (--remove all: the one surface again)");
  const auto values = std::make_shared<LayerValues>();
  arguments::Option* name =
      command->add_option("name", values->name, "Its name, such as skin")->option_text("NAME");
  arguments::Option* remove =
      command->add_option("--remove", values->remove, "Removes this one, or all")
          ->option_text("NAME|all")
          ->excludes(name);
  command->add_option("--isovalue", values->isovalue, "Where it is, in data units, or a name")
      ->option_text("X|NAME")
      ->excludes(remove);
  const auto add = [&](const std::string& option, std::optional<double>& value,
                       const std::string& about) {
    command->add_option(option, value, about)
        ->check(arguments::NonNegativeNumber())
        ->excludes(remove);
  };
  add("--stiffness", values->stiffness, "Force per way into it, N/mm");
  add("--damping", values->damping, "Damping along its normal, N·s/m");
  add("--static-friction", values->static_friction, "Friction at rest");
  add("--sliding-friction", values->sliding_friction, "Friction while sliding");
  add("--pop-n", values->pop_n, "Force at which the stylus passes it, N; 0: never");
  add("--pop-out-n", values->pop_out_n, "The same outwards; without it, as --pop-n");
  add("--viscosity", values->viscosity, "Drag behind it, N·s/m");
  AddJson(*command, invocation);
  command->callback([&invocation, values] {
    if (values->name.empty() && values->remove.empty()) {
      throw arguments::UsageError("give a layer's NAME, or --remove NAME");
    }
    invocation.command = [values, &invocation](client::Calls& palpated) {
      RunLayer(palpated, *values, invocation.json);
    };
  });
}

}  // namespace palpate::cli
