#include "settings/versions.h"

#include <torch/version.h>

#include "commit.h"  // see write_commit.cmake

namespace cale {

std::string_view cale_version() {
    return CALE_VERSION;
}
std::string_view cale_commit() {
    return CALE_COMMIT;
}
std::string_view torch_version() {
    return TORCH_VERSION;
}
std::string_view ale_version() {
    return CALE_ALE_VERSION;
}

}  // namespace cale
