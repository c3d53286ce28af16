#include <google/protobuf/descriptor.pb.h>

#include <set>

#include "server/recording/recorded_messages.h"

namespace palpate {
namespace {

namespace pb = google::protobuf;

// Names of the messages and enumerations that a message holds, itself among them, and their files.
class Needed {
 public:
  void Add(const pb::Descriptor& message) {
    if (!names_.insert(message.full_name()).second) return;
    files_.insert(message.file());
    for (int n = 0; n < message.field_count(); ++n) {
      const pb::FieldDescriptor& field = *message.field(n);
      if (field.message_type()) Add(*field.message_type());
      if (field.enum_type()) Add(*field.enum_type());
    }
  }

  // Adds the file, after those that it needs.
  void Write(const pb::FileDescriptor& file, pb::FileDescriptorSet& set) {
    if (!files_.contains(&file) || !written_.insert(&file).second) return;
    pb::FileDescriptorProto pruned = Pruned(file);
    for (int n = 0; n < file.dependency_count(); ++n) {
      const pb::FileDescriptor& dependency = *file.dependency(n);
      if (files_.contains(&dependency)) pruned.add_dependency(dependency.name());
      Write(dependency, set);
    }
    set.add_file()->Swap(&pruned);
  }

 private:
  void Add(const pb::EnumDescriptor& enumeration) {
    names_.insert(enumeration.full_name());
    files_.insert(enumeration.file());
  }

  pb::FileDescriptorProto Pruned(const pb::FileDescriptor& file) const {
    pb::FileDescriptorProto all, pruned;
    file.CopyTo(&all);
    pruned.set_name(all.name());
    pruned.set_package(all.package());
    pruned.set_syntax(all.syntax());
    for (pb::DescriptorProto& message : *all.mutable_message_type()) {
      if (!names_.contains(all.package() + "." + message.name())) continue;
      message.clear_options();
      for (pb::FieldDescriptorProto& field : *message.mutable_field()) field.clear_options();
      pruned.add_message_type()->Swap(&message);
    }
    for (pb::EnumDescriptorProto& enumeration : *all.mutable_enum_type()) {
      if (!names_.contains(all.package() + "." + enumeration.name())) continue;
      enumeration.clear_options();
      for (auto& value : *enumeration.mutable_value()) value.clear_options();
      pruned.add_enum_type()->Swap(&enumeration);
    }
    return pruned;
  }

  std::set<std::string> names_;
  std::set<const pb::FileDescriptor*> files_, written_;
};

}  // namespace

std::string SchemaOf(const pb::Descriptor& message) {
  Needed needed;
  needed.Add(message);
  pb::FileDescriptorSet set;
  needed.Write(*message.file(), set);
  return set.SerializeAsString();
}

}  // namespace palpate
