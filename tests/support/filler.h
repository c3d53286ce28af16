// Messages in which every field is set.
#pragma once

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <string>

namespace palpate::testing {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

// Fills a message, another way in each round: a scalar gets a number that no other one has. In some
// round any two flags differ, and each member of a oneof is there.
class Filler {
 public:
  static constexpr int kRounds = 8;

  explicit Filler(int round) : round_(round) {}

  void Fill(Message& message) {
    const auto& type = *message.GetDescriptor();
    const Reflection& to = *message.GetReflection();
    for (int n = 0; n < type.field_count(); ++n) {
      const FieldDescriptor* field = type.field(n);
      const auto* oneof = field->real_containing_oneof();
      if (oneof && field->index_in_oneof() != round_ % oneof->field_count()) continue;
      // Nine numbers make the matrix of a map.
      const int times = field->name() == "linear" ? 9 : field->is_repeated() ? 2 : 1;
      for (int time = 0; time < times; ++time) {
        if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) {
          FillScalar(message, field);
        } else {
          Fill(field->is_repeated() ? *to.AddMessage(&message, field)
                                    : *to.MutableMessage(&message, field));
        }
      }
    }
  }

 private:
  void FillScalar(Message& message, const FieldDescriptor* field) {
    const Reflection& to = *message.GetReflection();
    const int number = ++number_;
    const auto count = static_cast<std::uint32_t>(number);
    const bool adds = field->is_repeated();
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return adds ? to.AddDouble(&message, field, number + 0.5)
                    : to.SetDouble(&message, field, number + 0.5);
      case FieldDescriptor::CPPTYPE_INT64:
        return to.SetInt64(&message, field, -number);
      case FieldDescriptor::CPPTYPE_UINT32:
        return to.SetUInt32(&message, field, count);
      case FieldDescriptor::CPPTYPE_UINT64:
        return adds ? to.AddUInt64(&message, field, count) : to.SetUInt64(&message, field, count);
      case FieldDescriptor::CPPTYPE_BOOL:
        return to.SetBool(&message, field, (number >> round_ & 1) != 0);
      case FieldDescriptor::CPPTYPE_STRING:
        return adds ? to.AddString(&message, field, std::to_string(number))
                    : to.SetString(&message, field, std::to_string(number));
      case FieldDescriptor::CPPTYPE_ENUM:
        // The last one: all of them would be tested by their numbers alone.
        return to.SetEnumValue(&message, field, field->enum_type()->value_count() - 1);
      default:
        FAIL() << field->full_name() << ": a type that this test does not know";
    }
  }

  const int round_;
  int number_ = 0;
};

}  // namespace palpate::testing
