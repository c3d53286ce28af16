// A setting of palpated: how a panel shows it, a change by this user, and its undo. Undo never
// overwrites the value of another client.
//
// Values: numbers as they are, flags 0 or 1, choices by their place.
// Threads: plain values; functions from any thread.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "client/sdk/settings.h"

namespace palpate::view {

// False while the setting has no effect: it belongs to one that is off, layers have their own, or a
// tool is held.
bool IsShown(const client::Setting& setting, const client::Settings& settings);

// The slider's printf format: "%.2f N/mm". `setting` must be a number.
std::string SliderFormat(const client::Setting& setting);

double ValueOf(const client::Setting& setting, const client::Settings& settings);
client::SettingsUpdate UpdateTo(const client::Setting& setting, double value);
void SetIn(const client::Setting& setting, double value, client::SettingsUpdate& update);
// Up to what a double loses on its way.
bool IsSame(double a, double b);

struct SettingChange {
  const client::Setting* setting = nullptr;  // one of kSettings
  double before = 0.0;
  double after = 0.0;
};

// Joins the changes of one drag: from the value before the first one to that after the last one.
class SettingDrag {
 public:
  // Returns the drag of another setting, which this change has ended.
  std::optional<SettingChange> Add(const SettingChange& change);
  // The control was released. Returns nothing if there was no drag or it ended where it began.
  std::optional<SettingChange> End();

 private:
  std::optional<SettingChange> open_;
};

// The settings of palpated, for RestoreSetting.
struct SettingAccess {
  std::function<client::Settings()> get;
  // Throws Error (kConflict) if expected_revision is not that of the settings.
  std::function<void(const client::SettingsUpdate&)> set;
  // Who changed the setting last, for people: "token ada at 192.0.2.7, 3 s ago"; empty: unknown.
  std::function<std::string()> changed_by;
};

// Undoes the change, or redoes it (`forward`). Throws Error with kConflict if the setting no longer
// has the value that this viewer gave it, naming who changed it; and what the access throws.
void RestoreSetting(const SettingChange& change, bool forward, const SettingAccess& access);

}  // namespace palpate::view
