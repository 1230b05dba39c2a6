// Checked standard output, which may be a file on a full disk.
#pragma once

namespace cale {

/// Must be called after all output. Throws std::runtime_error with the reason if part of it was not written.
void flush_standard_output();

}  // namespace cale
