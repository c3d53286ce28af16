#include "server/app/config.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <set>
#include <sstream>
#include <string_view>

#include "common/error/one_line.h"
#include "server/app/config_keys.h"
#include "server/kept/state_file.h"

namespace palpate {
namespace {

// 1 and 1.0 give the same text.
std::string Value(const toml::node& node) {
  if (node.is_number()) return fmt::format("{}", ToDouble(node));
  std::ostringstream text;
  node.visit([&](const auto& value) { text << value; });
  return text.str();
}

// The tables of all keys: "haptics" for "haptics.method". Every table has keys.
std::set<std::string> Tables() {
  std::set<std::string> tables;
  for (const auto& [key, set] : ConfigSetters()) tables.insert(key.substr(0, key.find('.')));
  return tables;
}

bool IsIsovalue(std::string_view key) {
  return key == "volume.isovalue" || key == "volume.normalized_isovalue";
}

class Reader {
 public:
  Reader(const ConfigOverrides& overrides, Config& config)
      : overrides_(overrides), config_(config) {}

  void ReadFile(const std::filesystem::path& path) {
    try {
      ReadTable(toml::parse_file(path.string()), "");
    } catch (const toml::parse_error& error) {
      const std::size_t line = error.source().begin.line;
      const std::string what = OneLine(error.description());
      // Line 0: the file cannot be opened.
      reading_.faults.push_back({"", line, line > 0 ? what : path.string() + ": " + what});
    }
  }
  void ReadOverrides() {
    for (const ConfigOverride& one : overrides_) {
      toml::array node;  // of one
      std::visit([&](const auto& given) { Append(given, node); }, one.value);
      Set(one.key, node[0], config_);
    }
  }
  ConfigReading Take() { return std::move(reading_); }

 private:
  template <class T>
  static void Append(const T& value, toml::array& to) {
    to.push_back(value);
  }
  template <class T>
  static void Append(const std::vector<T>& values, toml::array& to) {
    toml::array list;
    for (const T& value : values) list.push_back(value);
    to.push_back(std::move(list));
  }

  void ReadTable(const toml::table& table, const std::string& prefix) {
    for (const auto& [name, node] : table) {
      const std::string key = prefix + std::string(name.str());
      const std::size_t line = node.source().begin.line;
      const toml::table* const section = node.as_table();
      if (section && !Tables().contains(key)) {
        reading_.faults.push_back(
            {key, line,
             fmt::format("is no table of palpated: there are {}", fmt::join(Tables(), ", "))});
      } else if (section) {
        ReadTable(*section, key + ".");
      } else if (IsReplaced(key)) {
        Config unused;
        Set(key, node, unused);
      } else if (Set(key, node, config_)) {
        reading_.keys[key] = {line, Value(node)};
      }
    }
  }

  bool IsReplaced(const std::string& key) const {
    return std::any_of(overrides_.begin(), overrides_.end(), [&](const ConfigOverride& one) {
      return key == one.key || (IsIsovalue(key) && IsIsovalue(one.key)) ||
             (one.key == "volume.source" && IsOfSource(key));
    });
  }

  bool Set(const std::string& key, const toml::node& node, Config& config) {
    try {
      const auto setter = ConfigSetters().find(key);
      if (setter == ConfigSetters().end()) Refuse("is no setting of palpated");
      setter->second(node, config);
      return true;
    } catch (const Error& error) {
      reading_.faults.push_back({key, node.source().begin.line, error.what()});
      return false;
    }
  }

  const ConfigOverrides& overrides_;
  Config& config_;
  ConfigReading reading_;
};

// True if `what` continues a sentence that begins with the key.
bool GoesOn(std::string_view what) {
  return what.starts_with("must ") || what.starts_with("is ") || what.starts_with("has ") ||
         what.starts_with("needs ");
}

}  // namespace

ConfigReading ReadConfig(const std::filesystem::path& path, const ConfigOverrides& overrides,
                         Config& config) {
  Reader reader(overrides, config);
  if (!path.empty()) reader.ReadFile(path);
  reader.ReadOverrides();
  return reader.Take();
}

std::string ToText(const std::filesystem::path& path, const ConfigFault& fault) {
  std::string text;
  if (fault.line > 0) text = fmt::format("{}:{}: ", path.string(), fault.line);
  if (fault.key.empty()) return text + fault.what;
  return text + fault.key + (GoesOn(fault.what) ? " " : ": ") + fault.what;
}

Error AtKey(const LoadedConfig& loaded, std::string_view key, const Error& error) {
  const auto at = loaded.keys.find(key);
  if (at == loaded.keys.end()) return error;
  const ConfigFault fault{at->first, at->second.line, error.what()};
  return {error.kind(), ToText(loaded.file, fault)};
}

}  // namespace palpate
