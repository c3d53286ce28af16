// Where the programs and files lie that tests run and read: absolute paths. One file holds them,
// so that the tests' own files compile to the same objects in every checkout.
#pragma once

namespace palpate::test {

extern const char* const kPalpated;
extern const char* const kPalpate;
extern const char* const kPalpateImport;
extern const char* const kPalpateLab;

// Programs that tests start to see them end.
extern const char* const kConfinedChild;
extern const char* const kHonestyChild;
extern const char* const kRecordingChild;
extern const char* const kUsbClientChild;
extern const char* const kVolumeExportChild;
// Writes .vdb files, and judges them.
extern const char* const kVdbTool;
// A script in palpated's place, that ends badly when told to.
extern const char* const kStandIn;

// HD libraries of our own: whole, and without one of its functions.
extern const char* const kFakeHd;
extern const char* const kFakeHdMissing;

// Folders of this project's files.
extern const char* const kCaptures;
extern const char* const kCells;
extern const char* const kFuzzCorpus;
// The configuration that the package installs.
extern const char* const kExampleConfig;

// What is not part of the project: real volumes, and the published cells. Either may be missing.
extern const char* const kDataFolder;
extern const char* const kSharedCells;

}  // namespace palpate::test
