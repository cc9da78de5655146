/* Stub for tests, no cisst: see ../../README.md. */
#include <cisst_stub.h>
