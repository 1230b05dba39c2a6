// The standard streams: open from the start, and checked at the end, as the output may be a file on a full
// disk.
#pragma once

namespace cale {

/// Puts /dev/null in the place of a standard stream that is closed, before a file gets its number and the
/// program's output with it. Writing there fails, as it does to a closed stream. A file that may not grow any
/// more (ulimit -f) is from then on an error of writing, and no signal that ends the process.
void open_standard_streams();

/// Must be called after all output. Throws std::runtime_error with the reason if part of it was not written.
void flush_standard_output();

}  // namespace cale
