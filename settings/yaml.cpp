#include "settings/yaml.h"

#include <sstream>
#include <vector>

#include <yaml-cpp/eventhandler.h>

namespace cale {
namespace {

/// Where the documents of a YAML stream begin.
struct DocumentStarts : YAML::EventHandler {
    std::vector<YAML::Mark> marks;

    void OnDocumentStart(const YAML::Mark& mark) override { marks.push_back(mark); }
    void OnDocumentEnd() override {}
    void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
    void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
    void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t, const std::string&) override {}
    void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                         YAML::EmitterStyle::value) override {}
    void OnSequenceEnd() override {}
    void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                    YAML::EmitterStyle::value) override {}
    void OnMapEnd() override {}
};

}  // namespace

YAML::Node parse_yaml(const std::string& text) {
    DocumentStarts starts;
    YAML::Node document;
    try {
        std::istringstream stream(text);
        YAML::Parser parser(stream);
        // Not YAML::LoadAll(), which on some malformed files takes empty documents for ever.
        while (starts.marks.size() < 2 && parser.HandleNextDocument(starts)) {
        }
        document = YAML::Load(text);
    } catch (const YAML::Exception& error) {
        throw YAML::Exception(error.mark, "not valid YAML: " + error.msg);
    }
    if (starts.marks.size() > 1)
        throw YAML::Exception(starts.marks[1], "a second YAML document ('---'); a file may hold one only");
    return document;
}

}  // namespace cale
