#include "server/recording/csv_export.h"

#include <array>
#include <charconv>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>

#include "common/error/error.h"
#include "server/recording/sample_fields.h"
#include "server/safety/names.h"

namespace palpate {
namespace {

constexpr std::array<std::string_view, 6> kModeNames = {"free",  "constrained", "ejecting",
                                                        "fault", "suspended",   "inside"};

template <class Field>
void AppendField(const Field& field, std::string& row) {
  if constexpr (std::is_same_v<Field, TickMode>) {
    row += kModeNames[static_cast<std::size_t>(field)];
  } else if constexpr (std::is_same_v<Field, FreeSide>) {
    row += FreeSideName(field);
  } else if constexpr (std::is_enum_v<Field>) {
    row += NameOf(field);
  } else if constexpr (std::is_same_v<Field, bool>) {
    row += field ? '1' : '0';
  } else {
    std::array<char, 32> digits;
    row.append(digits.data(),
               std::to_chars(digits.data(), digits.data() + digits.size(), field).ptr);
  }
  row += ',';
}

std::string Header() {
  std::string row;
  const TickSample sample;
  VisitFields(sample, [&](std::string_view name, const auto&) { row.append(name).append(","); });
  return row + "markers";
}

// Adds quotes if commas, quotes or line ends would break the table.
std::string Quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted.append(c == '"' ? 2 : 1, c);
  return quoted + '"';
}

// Holds back the last row, because markers after the last tick are added to this row.
class Table {
 public:
  explicit Table(std::ostream& stream) : stream_(stream) { stream_ << Header() << '\n'; }

  void Add(const TickSample& sample) {
    if (!row_.empty()) WriteRow(row_markers_);
    row_.clear();
    VisitFields(sample, [&](std::string_view, const auto& field) { AppendField(field, row_); });
    row_markers_ = std::move(next_markers_);
    next_markers_.clear();
  }

  void Add(const RecordedMarker& marker) { Join(next_markers_, marker.text); }

  void End() {
    Join(row_markers_, next_markers_);
    if (!row_.empty()) WriteRow(row_markers_);
    stream_.flush();
    CheckStream();
  }

 private:
  static void Join(std::string& texts, const std::string& text) {
    if (!texts.empty() && !text.empty()) texts += "; ";
    texts += text;
  }

  void WriteRow(const std::string& markers) {
    stream_ << row_ << Quoted(markers) << '\n';
    CheckStream();
  }

  void CheckStream() const {
    if (!stream_) {
      throw Error(ErrorKind::kUnavailable, "cannot write the table; is there space?");
    }
  }

  std::ostream& stream_;
  std::string row_;
  std::string row_markers_;
  std::string next_markers_;
};

}  // namespace

void ExportCsv(RecordingReader& reader, std::ostream& stream) {
  Table table(stream);
  while (const std::optional<RecordedChunk> chunk = reader.Next()) {
    if (const auto* samples = std::get_if<RecordedSamples>(&*chunk)) {
      for (const TickSample& sample : *samples) table.Add(sample);
    } else if (const auto* marker = std::get_if<RecordedMarker>(&*chunk)) {
      table.Add(*marker);
    }
  }
  table.End();
}

void ExportCsv(std::span<const TickSample> ticks, std::ostream& stream) {
  Table table(stream);
  for (const TickSample& sample : ticks) table.Add(sample);
  table.End();
}

}  // namespace palpate
