// The written enumerations against protobuf's own.
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <string>

#include "common/contract/enumerations.h"
#include "palpate/v1/device.pb.h"
#include "palpate/v1/edit.pb.h"
#include "palpate/v1/pose.pb.h"
#include "palpate/v1/render.pb.h"
#include "palpate/v1/voxel_type.pb.h"
#include "palpate/v1/words.pb.h"

namespace palpate {
namespace {

template <class Enum>
void ExpectDeclared(const google::protobuf::EnumDescriptor& declared) {
  SCOPED_TRACE(declared.name());
  ASSERT_EQ(static_cast<int>(kEnumerators<Enum>.size()), declared.value_count());
  const std::string& first = declared.value(0)->name();
  const std::string prefix = first.substr(0, first.size() - std::string("UNSPECIFIED").size());
  for (int number = 1; number < declared.value_count(); ++number) {
    const auto* value = declared.FindValueByNumber(number);
    std::string word = value->name().substr(prefix.size());
    std::ranges::transform(word, word.begin(), [](unsigned char c) {
      return c == '_' ? '-' : static_cast<char>(std::tolower(c));
    });
    const auto read = EnumeratorOf<Enum>(number);
    EXPECT_EQ(static_cast<int>(read), number);
    EXPECT_EQ(NameOf(read), word);
    EXPECT_EQ(Named<Enum>(word), read);
    EXPECT_EQ(Describe(read).says, value->options().GetExtension(v1::says));
    EXPECT_EQ(Describe(read).advice, value->options().GetExtension(v1::advice));
  }
  for (const int other : {-1, 0, declared.value_count(), 1 << 30}) {
    EXPECT_EQ(EnumeratorOf<Enum>(other), Enum::kUnknown);
  }
  for (const char* word : {"", "unknown", "UNSPECIFIED"}) EXPECT_FALSE(Named<Enum>(word));
}

TEST(Contract, EnumerationsAreAsDeclared) {
  ExpectDeclared<ForceState>(*v1::ForceState_descriptor());
  ExpectDeclared<ForceReason>(*v1::ForceReason_descriptor());
  ExpectDeclared<ForceCommand>(*v1::ForceCommand_descriptor());
  ExpectDeclared<DeviceStatus>(*v1::DeviceStatus_descriptor());
  ExpectDeclared<DeviceConnection>(*v1::DeviceConnection_descriptor());
  ExpectDeclared<VerificationLevel>(*v1::VerificationLevel_descriptor());
  ExpectDeclared<Role>(*v1::Role_descriptor());
  ExpectDeclared<EditFrame>(*v1::EditFrame_descriptor());
  ExpectDeclared<EditOperation>(*v1::EditOperation_descriptor());
  ExpectDeclared<FilterKind>(*v1::FilterKind_descriptor());
  ExpectDeclared<ProxyMode>(*v1::ProxyMode_descriptor());
  ExpectDeclared<DecompositionMethod>(*v1::DecompositionMethod_descriptor());
  ExpectDeclared<FreeSide>(*v1::FreeSide_descriptor());
  ExpectDeclared<VoxelType>(*v1::VoxelType_descriptor());
}

TEST(Contract, AReasonIsTheSentenceAndWhatToDo) {
  EXPECT_EQ(InWords(ForceReason::kDocked), "the stylus rests in its holder: take it out");
  EXPECT_EQ(InWords(ForceReason::kReplay), "until the replay ends");
  EXPECT_EQ(InWords(ForceReason::kNone), "");
}

}  // namespace
}  // namespace palpate
