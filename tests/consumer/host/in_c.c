// SPDX-License-Identifier: Apache-2.0
// Never built: the test configures alone.
#include <nearmesh.h>

int main(void) { return nearmesh_has_dds() ? 0 : 1; }
