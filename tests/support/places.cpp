#include "tests/support/places.h"

namespace palpate::test {

const char* const kPalpated = PALPATED;
const char* const kPalpate = PALPATE;
const char* const kPalpateImport = PALPATE_IMPORT;
const char* const kPalpateLab = PALPATE_LAB;

const char* const kConfinedChild = CONFINED_CHILD;
const char* const kRecordingChild = RECORDING_CHILD;
const char* const kStopChild = STOP_CHILD;
const char* const kVdbTool = VDB_TOOL;

const char* const kFakeHd = FAKE_LIBHD;
const char* const kFakeHdMissing = FAKE_LIBHD_MISSING;
const char* const kFakeDrd = FAKE_LIBDRD;
const char* const kFakeDrdMissing = FAKE_LIBDRD_MISSING;
const char* const kFakeDrdOld = FAKE_LIBDRD_OLD;
const char* const kHaplyServiceScript = PALPATE_TESTS "/support/haply_service.py";

const char* const kCaptures = PALPATE_TESTS "/data/captures";
const char* const kPatientLetters = PALPATE_TESTS "/web/patient_letters.txt";
const char* const kCells = PALPATE_TESTS "/data/cells";
const char* const kFuzzCorpus = PALPATE_FUZZ_CORPUS;
const char* const kExampleConfig = PALPATE_TESTS "/../deploy/config/palpated.toml";

const char* const kDataFolder = PALPATE_DATA_DIR;
const char* const kSharedCells = PALPATE_DATA_DIR "/../cells";

}  // namespace palpate::test
