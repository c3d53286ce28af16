// In place of the C library's, in sanitizer builds: a library that was opened stays.
//
// What Mesa's drivers never free could not be told from a leak of ours once their
// libraries are gone: the report would have no names.
extern "C" int dlclose(void* /*library*/) { return 0; }
