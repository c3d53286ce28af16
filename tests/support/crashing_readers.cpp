// Loaded before GDCM and libtiff, their readers crash: as they do on some valid files.
#include <cstdlib>

extern "C" {
bool CrashInGdcm() __asm__("_ZN4gdcm11ImageReader4ReadEv");
bool CrashInGdcm() { std::abort(); }
void* TIFFOpen(const char*, const char*) { return *static_cast<void* volatile*>(nullptr); }
}
