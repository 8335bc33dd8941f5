// SPDX-License-Identifier: Apache-2.0
// Never built: the test configures alone.
#include "nearmesh/subscriber/peer/session.hpp"

int main() { return 0; }
