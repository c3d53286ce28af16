// `palpate set`, `layers` and `layer`.
#include "client/cli/set_command.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/isovalues.h"
#include "client/cli/output.h"
#include "client/cli/setting.h"
#include "client/sdk/words.h"
#include "common/error/error.h"
#include "common/error/text.h"
#include "common/files/text_file.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::milliseconds kLook(100);

std::vector<std::string> Names() {
  std::vector<std::string> names;
  for (const Setting& setting : client::kSettings) names.emplace_back(setting.name);
  return names;
}

// The values of the options.
struct SetValues {
  std::string key;
  std::string value;
  bool normalized = false;
  client::SettingsUpdate update;
};

const Setting& Named(const std::string& key) {
  if (const Setting* setting = FindSetting(key)) return *setting;
  throw arguments::UsageError("there is no setting '" + key + "'" +
                              arguments::DidYouMean(key, Names()));
}

void StoreValue(const Setting& setting, const std::string& value, client::SettingsUpdate& update) {
  if (StoreSetting(setting, value, update)) return;
  throw arguments::UsageError(
      fmt::format("{} cannot be '{}': give {}", setting.name, value, ValuesOf(setting)));
}

const Setting& TakeSetting(SetValues& values) {
  const Setting* setting = &Named(values.key);
  if (values.normalized) {
    if (setting != &client::kIsovalue) {
      throw arguments::UsageError("--normalized is for the isovalue");
    }
    setting = &client::kNormalizedIsovalue;
  }
  // A word is one of the volume's, which only the daemon knows.
  const bool is_word =
      !values.value.empty() && std::isalpha(static_cast<unsigned char>(values.value.front())) != 0;
  if (setting == &client::kIsovalue && is_word) return *setting;
  StoreValue(*setting, values.value, values.update);
  return *setting;
}

bool Names(const client::SettingsUpdate& update, const Setting& setting) {
  return std::visit(
      [&](const auto& kind) {
        if constexpr (requires { kind.updated; }) {
          return kind.updated(update).has_value();
        } else {
          return (update.*kind.update).has_value();
        }
      },
      setting.kind);
}

bool NamesAny(const client::SettingsUpdate& update, bool Setting::*trait) {
  return std::ranges::any_of(client::kSettings, [&](const Setting& setting) {
    return setting.*trait && Names(update, setting);
  });
}

// The commands that end what forbids the update: layers, or the side of layers.
std::vector<std::string> WaysWithLayers(const client::Settings& now,
                                        const client::SettingsUpdate& update) {
  if (update.layers) {
    if (now.free_side == client::FreeSide::kAbove) return {"palpate set free_side below"};
  } else if (!now.layers.layer.empty() && NamesAny(update, &Setting::of_layers)) {
    return {"palpate layer --remove all"};
  }
  return {};
}

// The same for a tool, held or to be taken.
std::vector<std::string> WaysWithTool(const client::Settings& now,
                                      const client::SettingsUpdate& update) {
  std::vector<std::string> ways;
  if (update.tool) {
    if (!now.layers.layer.empty()) ways.emplace_back("palpate layer --remove all");
    for (const Setting& setting : client::kSettings) {
      if (!setting.refused_with_tool || IsOff(setting, now)) continue;
      const bool is_flag = std::holds_alternative<client::FlagSetting>(setting.kind);
      ways.push_back(fmt::format("palpate set {} {}", setting.name, is_flag ? "off" : "0"));
    }
  } else if (!now.tool.ball.empty() &&
             (update.layers || NamesAny(update, &Setting::refused_with_tool))) {
    ways.emplace_back("palpate tool none");
  }
  return ways;
}

}  // namespace

client::SettingsResult SetOrSayHow(client::Calls& palpated,
                                   const client::SettingsUpdate& update) try {
  return palpated.Set(update);
} catch (const Error& refusal) {
  const auto ways_of = refusal.kind() == ErrorKind::kInvalidArgument      ? WaysWithLayers
                       : refusal.kind() == ErrorKind::kFailedPrecondition ? WaysWithTool
                                                                          : nullptr;
  const std::vector<std::string> ways =
      ways_of ? ways_of(palpated.GetSettings(), update) : std::vector<std::string>();
  if (ways.empty()) throw;
  throw Error(refusal.kind(), fmt::format("{}: '{}'", refusal.what(), fmt::join(ways, "; ")));
}

client::Settings WaitForTip(client::Calls& palpated, const client::Settings& asked) {
  client::Settings now = asked;
  const auto is_still_asked = [&] {
    return now.tool_radius_mm == asked.tool_radius_mm && now.tool == asked.tool;
  };
  WithProgress([&](const client::ProgressFunction& progress) {
    while (now.ball.is_awaited && is_still_asked()) {
      if (!progress({.stage = "making what is felt of the tip",
                     .fraction = now.ball.share_done.value_or(0.0)})) {
        throw Error(ErrorKind::kCancelled, "it goes on, and is felt when it is made");
      }
      std::this_thread::sleep_for(kLook);
      now = palpated.GetSettings();
    }
  });
  RequireLive(now);
  if (!is_still_asked()) {
    throw Error(ErrorKind::kConflict, "somebody else has set another tool or tool_radius");
  }
  return now;
}

namespace {

void Change(client::Calls& palpated, const Setting& setting, const SetValues& values, bool json) {
  client::SettingsUpdate update = values.update;
  if (&setting == &client::kIsovalue && !update.isovalue) {
    update.isovalue = SuggestedIsovalueOf(palpated.GetVolume(), values.value);
  }
  const client::SettingsResult result = SetOrSayHow(palpated, update);
  PrintNotKept(result.not_kept);
  if (update.tool_radius_mm || update.free_side) {
    const client::Settings felt = WaitForTip(palpated, result.settings);
    // A point has the side that was asked for.
    const bool has_side = !update.tool_radius_mm && felt.ball.felt_radius_mm == 0.0;
    if (!felt.ball.problem.empty() && !has_side) {
      throw Error(ErrorKind::kTooLarge, client::BallInWords(felt));
    }
  }
  if (!json) {
    const bool waits = setting.idle_with_tool && !result.settings.tool.ball.empty();
    return WriteOutput(
        DescribeChange(setting, result) +
        (waits ? "; it waits until the tool is put down ('palpate tool none')\n" : "\n"));
  }
  Json object = ToJson(result.settings);
  object["applied_tick"] = result.applied_tick;
  object["receipt_to_applied_ns"] = result.receipt_to_applied_ns;
  WriteOutput(ToText(object));
}

std::string DescribeValue(const Setting& setting, const client::Settings& settings) {
  if (&setting == &client::kNormalizedIsovalue) {
    return fmt::format("isovalue {:.9g} (normalised {:.9g})", settings.isovalue,
                       settings.normalized_isovalue);
  }
  return DescribeSetting(setting, settings);
}

}  // namespace

void AddSet(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand("set", "Changes what is felt, at one tick");
  SetFooter(*command, "KEY, with or without its unit (stiffness, stiffness_n_per_mm):\n" +
                          ListOfSettings() +
                          "Examples: palpate set isovalue -200\n"
                          "          palpate set isovalue bone    (palpate info lists the names)\n"
                          "          palpate set isovalue --normalized 0.4\n"
                          "          palpate set stiffness 0.8");
  const auto values = std::make_shared<SetValues>();
  command->add_option("key", values->key, "What to change, see below")
      ->required()
      ->option_text("KEY")
      ->suggest(Names());
  command->add_option("value", values->value, "Its new value")->required()->option_text("VALUE");
  command->add_flag("--normalized", values->normalized,
                    "The isovalue is given over the volume's range at load, 0 to 1");
  command->add_option("--expected-revision", values->update.expected_revision,
                      "Change it only on top of this settings revision, else exit with 7");
  AddJson(*command, invocation);
  command->callback([&invocation, values] {
    const Setting& setting = TakeSetting(*values);
    invocation.command = [values, &setting, &invocation](client::Calls& palpated) {
      Change(palpated, setting, *values, invocation.json);
    };
  });
}

void StoreNamedSetting(const std::string& text, client::SettingsUpdate& update) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) {
    throw arguments::UsageError("'" + text + "' is no setting: give KEY=VALUE");
  }
  StoreValue(Named(text.substr(0, equals)), text.substr(equals + 1), update);
}

std::string DescribeChange(const Setting& setting, const client::SettingsResult& result) {
  return fmt::format("{} applied at tick {}, settings revision {}, {:.1f} ms after receipt",
                     DescribeValue(setting, result.settings), result.applied_tick,
                     result.settings.revision,
                     static_cast<double>(result.receipt_to_applied_ns) * 1e-6);
}

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

void PrintLayers(const client::Settings& settings, bool json) {
  if (settings.replayed && !json) WriteOutput("of the replay:\n");
  WriteOutput(json ? ToJson(settings.layers).dump(2) + "\n" : Describe(settings.layers));
}

// `revision`: of the settings that the change is made from; none: whatever they are.
void Set(client::Calls& palpated, const SurfaceLayers& layers,
         const std::optional<std::uint64_t>& revision, bool json) {
  client::SettingsUpdate update;
  update.layers = layers;
  update.expected_revision = revision;
  const client::SettingsResult result = SetOrSayHow(palpated, update);
  PrintNotKept(result.not_kept);
  PrintLayers(result.settings, json);
  if (!json) WriteOutput(fmt::format("felt since tick {}\n", result.applied_tick));
}

void RunLayers(client::Calls& palpated, const LayersValues& values, bool json) {
  if (!values.load.empty()) {
    return Set(palpated, LayersOfJson(ReadTextFile(values.load, kMostLayersBytes)), std::nullopt,
               json);
  }
  if (values.list.empty()) return PrintLayers(palpated.GetSettings(), json);
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
