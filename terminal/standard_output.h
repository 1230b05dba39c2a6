// The standard output, which may be a file on a full disk.
#pragma once

namespace cale {

/// To be called when all is written. Throws std::runtime_error with the reason where part of it did not
/// arrive.
void flush_standard_output();

}  // namespace cale
