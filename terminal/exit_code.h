// How programs end, in numbers.
#pragma once

namespace cale {

/// The exit codes of the training programs and of cale; docs/reliability.md says when each is used.
enum ExitCode { kDone = 0, kFailed = 1, kUsage = 2, kCannotResume = 3, kDiverged = 4, kInterrupted = 130 };

}  // namespace cale
