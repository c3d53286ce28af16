#include "server/recording/csv_export.h"

#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>

#include "common/contract/enumerations.h"
#include "common/error/error.h"
#include "server/recording/sample_fields.h"

namespace palpate {
namespace {

template <class Field>
void AppendField(const Field& field, std::string& row) {
  if constexpr (std::is_enum_v<Field>) {
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
  return row + "lost_ticks,unix_ns,markers";
}

// Adds quotes if commas, quotes or line ends would break the table.
std::string Quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted.append(c == '"' ? 2 : 1, c);
  return quoted + '"';
}

class Table {
 public:
  Table(std::ostream& stream, const RecordingHeader& header) : stream_(stream), header_(header) {
    stream_ << Header() << '\n';
  }

  void Add(const TickSample& sample) {
    row_.clear();
    VisitFields(sample, [&](std::string_view name, const auto& field) {
      // What the tick does not have is empty, which other programs read as missing.
      const bool is_absent = (!sample.contact && name.starts_with("scp_h_normal")) ||
                             (!sample.has_scp_v && name.starts_with("scp_v")) ||
                             (!sample.is_led() && name.starts_with("led")) ||
                             (!sample.shows_series() && name.starts_with("series"));
      if (is_absent) {
        row_ += ',';
      } else {
        AppendField(field, row_);
      }
    });
    AppendField(lost_ticks_, row_);
    if (const auto unix_ns = header_.UnixOf(sample.time_ns)) row_ += std::to_string(*unix_ns);
    stream_ << row_ << ',' << Quoted(std::exchange(markers_, {})) << '\n';
    CheckStream();
  }

  // Of the next tick.
  void Add(const RecordedEvent& event) {
    markers_ += (markers_.empty() ? "" : "; ") + event.marker;
  }

  void Add(const RecordedGap& gap) { lost_ticks_ += gap.last_tick - gap.first_tick + 1; }

  void End() {
    stream_.flush();
    CheckStream();
  }

 private:
  void CheckStream() const {
    if (!stream_) {
      throw Error(ErrorKind::kUnavailable, "cannot write the table; is there space?");
    }
  }

  std::ostream& stream_;
  const RecordingHeader header_;
  std::string row_;
  std::string markers_;           // of the next row
  std::uint64_t lost_ticks_ = 0;  // before the next row
};

}  // namespace

void ExportCsv(RecordingReader& reader, std::ostream& stream) {
  Table table(stream, reader.header());
  while (std::optional<RecordedItem> item = reader.Next()) {
    if (const auto* samples = std::get_if<RecordedSamples>(&*item)) {
      for (const TickSample& sample : *samples) table.Add(sample);
    } else if (const auto* event = std::get_if<RecordedEvent>(&*item)) {
      table.Add(*event);
    } else if (const auto* gap = std::get_if<RecordedGap>(&*item)) {
      table.Add(*gap);
    }
  }
  table.End();
}

void ExportCsv(std::span<const TickSample> ticks, std::ostream& stream) {
  Table table(stream, {});
  std::uint64_t next = ticks.empty() ? 0 : ticks.front().tick;
  for (const TickSample& sample : ticks) {
    if (sample.tick > next) table.Add(RecordedGap{next, sample.tick - 1});
    next = sample.tick + 1;
    table.Add(sample);
  }
  table.End();
}

}  // namespace palpate
