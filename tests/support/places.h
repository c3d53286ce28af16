// Absolute paths of the programs and files that tests use. They are defined in one file, so that
// all other test files compile to the same objects in every checkout.
#pragma once

namespace palpate::test {

extern const char* const kPalpated;
extern const char* const kPalpate;
extern const char* const kPalpateImport;
extern const char* const kPalpateLab;

// Programs that tests start and end.
extern const char* const kConfinedChild;
extern const char* const kRecordingChild;
extern const char* const kStopChild;
// Writes .vdb files.
extern const char* const kVdbTool;

// Our own HD libraries: complete, and with one function missing.
extern const char* const kFakeHd;
extern const char* const kFakeHdMissing;
// Our own libdrd: complete, with one function missing, and too old.
extern const char* const kFakeDrd;
extern const char* const kFakeDrdMissing;
extern const char* const kFakeDrdOld;
extern const char* const kHaplyServiceScript;

// Folders of this project.
extern const char* const kCaptures;
extern const char* const kCells;
extern const char* const kFuzzCorpus;
// What directions of volumes are called.
extern const char* const kPatientLetters;
// The configuration that the package installs.
extern const char* const kExampleConfig;

// Data outside the project: real volumes, and the published cells. Either may be missing.
extern const char* const kDataFolder;
extern const char* const kSharedCells;

}  // namespace palpate::test
