#include "common/felt_tool/tool_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "common/error/text.h"
#include "common/files/text_file.h"

namespace palpate {
namespace {

// Of a tool of 64 balls with long comments. A longer one would take seconds to parse.
constexpr std::size_t kMostToolBytes = 256 << 10;

[[noreturn]] void RefuseAt(const toml::node& node, std::string_view why) {
  throw Error(ErrorKind::kInvalidArgument,
              fmt::format("line {}: {}", node.source().begin.line, why));
}

// Refuses keys that the table does not have.
void CheckKeys(const toml::table& table, std::initializer_list<std::string_view> known) {
  for (const auto& [key, value] : table) {
    if (std::ranges::find(known, key.str()) == known.end()) {
      RefuseAt(value, fmt::format("a tool has no '{}' here", key.str()));
    }
  }
}

double NumberOf(const toml::node& node, std::string_view key) {
  const auto number = node.value<double>();
  if (!node.is_number() || !number) RefuseAt(node, fmt::format("{} must be a number", key));
  return *number;
}

double NumberAt(const toml::table& table, std::string_view key, double otherwise) {
  const toml::node* node = table.get(key);
  return node ? NumberOf(*node, key) : otherwise;
}

Vec3 PlaceAt(const toml::table& table, std::string_view key) {
  const toml::array* array = table[key].as_array();
  if (!array || array->size() != 3) {
    RefuseAt(table, fmt::format("{} must be three numbers, in mm", key));
  }
  Vec3 place;
  for (int n = 0; n < 3; ++n) place[n] = NumberOf((*array)[static_cast<std::size_t>(n)], key);
  return place;
}

bool FlagAt(const toml::table& table, std::string_view key) {
  const toml::node* node = table.get(key);
  if (node && !node->is_boolean()) RefuseAt(*node, fmt::format("{} must be true or false", key));
  return node && node->value_or(false);
}

// Calls take(table) for each of [[key]].
template <class Take>
void ForEach(const toml::table& table, std::string_view key, Take take) {
  const toml::node* node = table.get(key);
  if (!node) return;
  const toml::array* array = node->as_array();
  if (!array) RefuseAt(*node, fmt::format("write [[{}]]", key));
  for (const toml::node& element : *array) {
    if (!element.is_table()) RefuseAt(element, fmt::format("write [[{}]]", key));
    take(*element.as_table());
  }
}

HeldToolBall BallOf(const toml::table& table) {
  CheckKeys(table, {"center_mm", "radius_mm", "carves"});
  return {.center_mm = PlaceAt(table, "center_mm"),
          .radius_mm = NumberAt(table, "radius_mm", 0.0),
          .carves = FlagAt(table, "carves")};
}

void AddLine(const toml::table& table, HeldTool& tool) {
  CheckKeys(table, {"from_mm", "to_mm", "count", "radius_mm", "carves"});
  const Vec3 from_mm = PlaceAt(table, "from_mm"), to_mm = PlaceAt(table, "to_mm");
  const auto count = table["count"].value_exact<std::int64_t>();
  if (!count || *count < 2 || *count > kMostBallsOfALine) {
    RefuseAt(table, "count must be a whole number of balls, 2 at least");
  }
  const double radius_mm = NumberAt(table, "radius_mm", 0.0);
  const bool carves = FlagAt(table, "carves");
  for (std::int64_t n = 0; n < *count; ++n) {
    const double share = static_cast<double>(n) / static_cast<double>(*count - 1);
    tool.ball.push_back({from_mm + share * (to_mm - from_mm), radius_mm, carves});
  }
}

}  // namespace

HeldTool ParseTool(std::string_view text, std::string_view name) try {
  HeldTool tool = ToolFromToml(toml::parse(text));
  if (!tool.ball.empty()) return tool;
  throw Error(ErrorKind::kInvalidArgument, "a tool needs at least one [[ball]] or [[line]]");
} catch (const toml::parse_error& error) {
  throw Error(ErrorKind::kInvalidArgument,
              fmt::format("{}, line {}: {}", name, error.source().begin.line, error.description()));
} catch (const Error& error) {
  throw Error(error.kind(), fmt::format("{}, {}", name, error.what()));
}

HeldTool ReadTool(const std::string& name) {
  if (name.find('/') != std::string::npos || name.ends_with(".toml")) {
    const std::filesystem::path path(name);
    return ParseTool(ReadTextFile(path, kMostToolBytes), path.filename().string());
  }
  std::vector<std::string_view> names;
  for (const OurTool& tool : OurTools()) {
    if (tool.name == name) return ParseTool(tool.text, tool.name);
    names.push_back(tool.name);
  }
  throw Error(ErrorKind::kNotFound,
              fmt::format("there is no tool '{}': there are {}; for a file of your own give its "
                          "name with .toml",
                          OneLine(name), fmt::join(names, ", ")));
}

HeldTool ToolFromToml(const toml::table& table) {
  CheckKeys(table, {"name", "rotation_length_mm", "ball", "line"});
  HeldTool tool;
  if (const toml::node* node = table.get("name")) {
    if (!node->is_string()) RefuseAt(*node, "name must be a text");
    tool.name = node->value_or(std::string());
  }
  tool.rotation_length_mm = NumberAt(table, "rotation_length_mm", 0.0);
  ForEach(table, "ball", [&](const toml::table& one) { tool.ball.push_back(BallOf(one)); });
  ForEach(table, "line", [&](const toml::table& line) { AddLine(line, tool); });
  return tool;
}

toml::table ToolToToml(const HeldTool& tool) {
  toml::array balls;
  for (const HeldToolBall& ball : tool.ball) {
    const Vec3& c = ball.center_mm;
    balls.push_back(toml::table{{"center_mm", toml::array{c.x(), c.y(), c.z()}},
                                {"radius_mm", ball.radius_mm},
                                {"carves", ball.carves}});
  }
  return toml::table{{"name", tool.name},
                     {"rotation_length_mm", tool.rotation_length_mm},
                     {"ball", std::move(balls)}};
}

}  // namespace palpate
