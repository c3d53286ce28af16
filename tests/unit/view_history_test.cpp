// Undo and redo of what the user did, among changes of others; judged by a model of its own.
#include "client/view/palpated/history.h"
#include "client/view/palpated/setting_change.h"

#include <gtest/gtest.h>

#include <array>
#include <deque>
#include <memory>
#include <optional>
#include <random>

#include "common/error/error.h"

namespace palpate::view {
namespace {

using client::kSettings;

const client::Setting& Named(std::string_view key) {
  return *std::find_if(kSettings.begin(), kSettings.end(),
                       [&](const client::Setting& s) { return s.key == key; });
}

void Apply(const client::Setting& setting, double value, client::Settings& settings) {
  const client::SettingsUpdate update = UpdateTo(setting, value);
  if (const auto* number = std::get_if<client::NumberSetting>(&setting.kind)) {
    settings.*number->member = *(update.*number->update);
  } else if (const auto* flag = std::get_if<client::FlagSetting>(&setting.kind)) {
    settings.*flag->member = *(update.*flag->update);
  } else {
    const auto& choice = std::get<client::ChoiceSetting>(setting.kind);
    choice.set(settings, *choice.updated(update));
  }
  ++settings.revision;
}

TEST(SettingChange, EverySettingGoesThereAndBack) {
  for (const client::Setting& setting : kSettings) {
    client::Settings settings;
    const double first = ValueOf(setting, settings);
    const double second = first > 0.5 ? 0.0 : 1.0;
    Apply(setting, second, settings);
    EXPECT_EQ(ValueOf(setting, settings), second) << setting.key;
    Apply(setting, first, settings);
    EXPECT_EQ(ValueOf(setting, settings), first) << setting.key;
  }
}

TEST(SettingDrag, IsOneChangeFromItsBeginToItsEnd) {
  const client::Setting& isovalue = Named("isovalue");
  const client::Setting& stiffness = Named("stiffness_n_per_mm");
  SettingDrag drag;
  EXPECT_FALSE(drag.End());
  EXPECT_FALSE(drag.Add({&isovalue, 1.0, 2.0}));
  EXPECT_FALSE(drag.Add({&isovalue, 2.0, 5.0}));
  EXPECT_FALSE(drag.Add({&isovalue, 5.0, 3.0}));
  const auto other = drag.Add({&stiffness, 0.5, 0.7});
  ASSERT_TRUE(other);
  EXPECT_EQ(other->setting, &isovalue);
  EXPECT_EQ(std::pair(other->before, other->after), std::pair(1.0, 3.0));
  const auto last = drag.End();
  ASSERT_TRUE(last);
  EXPECT_EQ(std::pair(last->before, last->after), std::pair(0.5, 0.7));
  EXPECT_FALSE(drag.End());
  // There and back is no change.
  drag.Add({&isovalue, 1.0, 2.0});
  drag.Add({&isovalue, 2.0, 1.0});
  EXPECT_FALSE(drag.End());
}

// Settings that others change at the worst time.
class Daemon {
 public:
  explicit Daemon(std::mt19937& random) : random_(random) {}

  double value(const client::Setting& setting) const { return ValueOf(setting, settings_); }
  void Set(const client::Setting& setting, double value) { Apply(setting, value, settings_); }
  SettingAccess access(const SettingChange& change, bool forward) {
    return {.get =
                [this] {
                  const client::Settings told = settings_;
                  if (interrupt && random_() % 3 == 0) interrupt();
                  return told;
                },
            .set =
                [this, change, forward](const client::SettingsUpdate& update) {
                  if (update.expected_revision != settings_.revision) {
                    throw Error(ErrorKind::kConflict, "another revision");
                  }
                  Apply(*change.setting, forward ? change.after : change.before, settings_);
                },
            .changed_by = [] { return "token lab-script, 3 s ago"; }};
  }
  // Called at times between a question and its answer's use.
  std::function<void()> interrupt;

 private:
  std::mt19937& random_;
  client::Settings settings_;
};

// A step of the viewer: its command runs when the queue comes to it.
struct Rig {
  explicit Rig(unsigned seed) : random(seed) {}

  std::mt19937 random;
  Daemon daemon{random};
  History history;
  std::deque<std::function<void()>> commands;
  int refused = 0;

  void Add(const SettingChange& change) {
    const auto lasts = std::make_shared<bool>(true);
    history.Add({.name = std::string(change.setting->name),
                 .go =
                     [this, change, lasts](bool forward) {
                       commands.push_back([this, change, lasts, forward] {
                         try {
                           RestoreSetting(change, forward, daemon.access(change, forward));
                         } catch (const Error& error) {
                           EXPECT_EQ(error.kind(), ErrorKind::kConflict);
                           ++refused;
                           *lasts = false;
                         }
                       });
                     },
                 .lasts = [lasts] { return *lasts; }});
  }
  void Change(const client::Setting& setting, double after) {
    const double before = daemon.value(setting);
    if (IsSame(before, after)) return;
    daemon.Set(setting, after);
    Add({&setting, before, after});
  }
  void RunAll() {
    for (; !commands.empty(); commands.pop_front()) commands.front()();
  }
  unsigned Pick(std::size_t count) { return static_cast<unsigned>(random() % count); }
};

const std::array kThings = {&Named("isovalue"), &Named("stiffness_n_per_mm"),
                            &Named("passivity_control"), &Named("method")};

// As written down by a person: values, what was done, what was undone.
struct Model {
  struct Done {
    std::size_t thing;
    double before;
    double after;
  };
  std::array<double, kThings.size()> values{};
  std::vector<Done> done;
  std::vector<Done> undone;

  void Change(std::size_t thing, double value) {
    if (values[thing] == value) return;
    done.push_back({thing, values[thing], value});
    undone.clear();
    values[thing] = value;
  }
  void Undo() {
    if (done.empty()) return;
    const Done step = done.back();
    done.pop_back();
    if (values[step.thing] != step.after) return;
    values[step.thing] = step.before;
    undone.push_back(step);
  }
  void Redo() {
    if (undone.empty()) return;
    const Done step = undone.back();
    undone.pop_back();
    if (values[step.thing] != step.before) return;
    values[step.thing] = step.after;
    done.push_back(step);
  }
};

TEST(History, AgreesWithAModelAmongChangesOfOthers) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    Rig rig(seed);
    Model model;
    for (std::size_t n = 0; n < kThings.size(); ++n)
      model.values[n] = rig.daemon.value(*kThings[n]);
    for (int step = 0; step < 200; ++step) {
      const std::size_t thing = rig.Pick(kThings.size());
      const double value = rig.Pick(2);  // few, so that others give back what was
      switch (rig.Pick(5)) {
        case 0:
          rig.Change(*kThings[thing], value);
          model.Change(thing, value);
          break;
        case 1:
          rig.daemon.Set(*kThings[thing], value);
          model.values[thing] = value;
          break;
        case 2:
          rig.history.Redo();
          model.Redo();
          break;
        default:
          rig.history.Undo();
          model.Undo();
      }
      rig.RunAll();
      for (std::size_t n = 0; n < kThings.size(); ++n) {
        ASSERT_EQ(rig.daemon.value(*kThings[n]), model.values[n]) << kThings[n]->key;
      }
      ASSERT_EQ(rig.history.undo_name().empty(), model.done.empty());
      ASSERT_EQ(rig.history.redo_name().empty(), model.undone.empty());
      if (!model.done.empty()) {
        ASSERT_EQ(rig.history.undo_name(), kThings[model.done.back().thing]->name);
      }
    }
  }
}

// Commands run late, and others change settings between two of their messages.
TEST(History, NeverUndoesTheValueOfAnother) {
  int refused = 0;
  int undone = 0;
  for (unsigned seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    Rig rig(seed);
    const std::array numbers = {&Named("isovalue"), &Named("stiffness_n_per_mm")};
    std::array<std::optional<double>, 2> of_others;
    double next = 1000.0;
    const auto other_changes = [&] {
      const std::size_t thing = rig.Pick(2);
      of_others[thing] = next += 1.0;
      rig.daemon.Set(*numbers[thing], next);
    };
    rig.daemon.interrupt = other_changes;
    for (int step = 0; step < 200; ++step) {
      const std::size_t thing = rig.Pick(2);
      switch (rig.Pick(6)) {
        case 0:
          // The viewer's own value is set after the commands before it.
          rig.RunAll();
          rig.Change(*numbers[thing], rig.Pick(4));
          of_others[thing].reset();
          break;
        case 1:
          other_changes();
          break;
        case 2:
          rig.history.Redo();
          break;
        case 3:
          rig.RunAll();
          break;
        default:
          undone += rig.history.Undo();
      }
      for (std::size_t n = 0; n < numbers.size(); ++n) {
        if (of_others[n]) {
          ASSERT_EQ(rig.daemon.value(*numbers[n]), *of_others[n]);
        }
      }
    }
    refused += rig.refused;
  }
  EXPECT_GT(refused, 1000);
  EXPECT_GT(undone - refused, 100);
}

TEST(History, AloneItGoesAllTheWayBackAndForth) {
  Rig rig(7);
  std::vector<std::array<double, kThings.size()>> states;
  const auto state = [&] {
    std::array<double, kThings.size()> values{};
    for (std::size_t n = 0; n < kThings.size(); ++n) values[n] = rig.daemon.value(*kThings[n]);
    return values;
  };
  states.push_back(state());
  for (int step = 0; step < 100; ++step) {
    rig.Change(*kThings[rig.Pick(kThings.size())], rig.Pick(2));
    if (state() != states.back()) states.push_back(state());
  }
  for (std::size_t n = states.size() - 1; n-- > 0;) {
    ASSERT_TRUE(rig.history.Undo());
    rig.RunAll();
    ASSERT_EQ(state(), states[n]);
  }
  EXPECT_FALSE(rig.history.Undo());
  // Several keys before the first command ran.
  while (rig.history.Redo()) {
  }
  rig.RunAll();
  EXPECT_EQ(state(), states.back());
  EXPECT_EQ(rig.refused, 0);
  rig.history.Forget();
  EXPECT_FALSE(rig.history.Undo() || rig.history.Redo());
}

TEST(History, ARefusalNamesWhoChangedIt) {
  std::mt19937 random(1);
  Daemon daemon(random);
  const SettingChange change{&Named("isovalue"), 1.0, 2.0};
  daemon.Set(*change.setting, 3.0);
  try {
    RestoreSetting(change, false, daemon.access(change, false));
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("token lab-script, 3 s ago"), std::string::npos);
  }
}

// Strokes that the brush has forgotten do not stand in the way.
TEST(History, StepsThatNoLongerLastAreSkipped) {
  History history;
  std::vector<std::string> went;
  std::array<bool, 3> lasts = {true, true, true};
  for (std::size_t n = 0; n < lasts.size(); ++n) {
    history.Add(
        {.name = std::to_string(n),
         .go = [&went,
                n](bool forward) { went.push_back((forward ? "+" : "-") + std::to_string(n)); },
         .lasts = [&lasts, n] { return lasts[n]; }});
  }
  lasts[2] = false;
  EXPECT_EQ(history.undo_name(), "1");
  EXPECT_TRUE(history.Undo());
  lasts[1] = false;
  EXPECT_EQ(history.redo_name(), "");
  EXPECT_FALSE(history.Redo());
  EXPECT_TRUE(history.Undo());
  EXPECT_FALSE(history.Undo());
  EXPECT_TRUE(history.Redo());
  EXPECT_EQ(went, (std::vector<std::string>{"-1", "-0", "+0"}));
}

TEST(History, ForgetsTheOldestOfTooMany) {
  History history;
  std::size_t undone = 0;
  for (std::size_t n = 0; n < History::kMost + 5; ++n) {
    history.Add({.name = "step", .go = [&](bool) { ++undone; }});
  }
  while (history.Undo()) {
  }
  EXPECT_EQ(undone, History::kMost);
}

}  // namespace
}  // namespace palpate::view
