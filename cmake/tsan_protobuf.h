// Included before everything under ThreadSanitizer: protobuf's map fields have two members more
// under it, of which the installed library, built without it, does not know.
#include <cstddef>  // the standard library has to know of the sanitizer
#undef __SANITIZE_THREAD__
#include <google/protobuf/map_field.h>
#define __SANITIZE_THREAD__ 1
