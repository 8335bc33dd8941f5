// SPDX-License-Identifier: Apache-2.0
#include "security_documents.hpp"

#include <fnmatch.h>
#include <tinyxml2.h>

#include <array>
#include <cstdio>
#include <map>
#include <utility>
#include <vector>

#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::wire {
namespace {

using tinyxml2::XMLDocument;
using tinyxml2::XMLElement;

constexpr std::time_t kDay_s = 24 * 60 * 60;
constexpr const char* kSignedForEach = "ENCRYPT_WITH_ORIGIN_AUTHENTICATION";
constexpr std::array kRoles{Role::kPublisher, Role::kSubscriber, Role::kRecorder};

constexpr const char* kHead =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
    "<dds xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
    "xsi:noNamespaceSchemaLocation=\"http://www.omg.org/spec/DDS-Security/20170901/";

/// -1 for what is not a date.
std::time_t parse_date(const std::string& text) {
  std::tm parts{};
  const char* end = strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S", &parts);
  return end == nullptr ? -1 : timegm(&parts);
}

/// The topics of every wire version, so that documents outlive an upgrade.
TopicNames all_versions(const std::string& prefix) { return TopicNames(prefix, "*"); }

/// As Fast DDS matches the names in documents.
bool matches(const std::string& pattern, const std::string& name) {
  return fnmatch(pattern.c_str(), name.c_str(), FNM_NOESCAPE) == 0;
}

std::string text_of(const XMLElement* element) {
  const char* text = element == nullptr ? nullptr : element->GetText();
  return text == nullptr ? "" : text;
}

const XMLElement* child_of(const XMLElement* element, const char* name) {
  return element == nullptr ? nullptr : element->FirstChildElement(name);
}

bool is_named(const XMLElement* list, const char* each, const std::string& name) {
  for (const XMLElement* e = child_of(list, each); e != nullptr; e = e->NextSiblingElement(each))
    if (matches(text_of(e), name)) return true;
  return false;
}

bool has_domain(const XMLElement* domains, std::uint32_t domain) {
  for (const XMLElement* e = child_of(domains, "id"); e != nullptr; e = e->NextSiblingElement("id"))
    if (text_of(e) == std::to_string(domain)) return true;
  for (const XMLElement* e = child_of(domains, "id_range"); e != nullptr;
       e = e->NextSiblingElement("id_range")) {
    const XMLElement *min = child_of(e, "min"), *max = child_of(e, "max");
    unsigned least = 0, most = 0;
    const bool above = min != nullptr && min->QueryUnsignedText(&least) == tinyxml2::XML_SUCCESS &&
                       least <= domain;
    const bool below = max == nullptr ||
                       (max->QueryUnsignedText(&most) == tinyxml2::XML_SUCCESS && most >= domain);
    if (above && below) return true;
  }
  return false;
}

/// Those of one kind and partition together: the handshake has room for some 4 kB.
void add_criteria(std::string& text, const std::vector<Endpoint>& endpoints) {
  std::map<std::pair<bool, std::string>, std::string> topics;  // in the schema's order
  for (const Endpoint& endpoint : endpoints)
    topics[{!endpoint.writes, endpoint.partition}] += "<topic>" + endpoint.topic + "</topic>";
  for (const auto& [kind, names] : topics) {
    const std::string what = kind.first ? "subscribe" : "publish";
    text += "        <" + what + "><topics>" + names + "</topics>";
    if (!kind.second.empty())
      text += "<partitions><partition>" + kind.second + "</partition></partitions>";
    text += "</" + what + ">\n";
  }
}

std::string topic_rule(const std::string& topic, const std::string& protection) {
  return "        <topic_rule>\n          <topic_expression>" + topic +
         "</topic_expression>\n"
         "          <enable_discovery_protection>true</enable_discovery_protection>\n"
         "          <enable_liveliness_protection>true</enable_liveliness_protection>\n"
         "          <enable_read_access_control>true</enable_read_access_control>\n"
         "          <enable_write_access_control>true</enable_write_access_control>\n"
         "          <metadata_protection_kind>" +
         protection +
         "</metadata_protection_kind>\n"
         "          <data_protection_kind>NONE</data_protection_kind>\n"
         "        </topic_rule>\n";
}

constexpr const char* kUnnamed = "does not allow to ";

/// What a grant says of one endpoint: "" allows it, else a clause. As in Fast DDS the first rule
/// that names the topic decides.
std::string judge_endpoint(const XMLElement* grant, const Endpoint& endpoint,
                           std::uint32_t domain) {
  const char* what = endpoint.writes ? "publish" : "subscribe";
  for (const XMLElement* rule = grant->FirstChildElement(); rule != nullptr;
       rule = rule->NextSiblingElement()) {
    bool named = false, in_partition = false;
    for (const XMLElement* c = child_of(rule, what); c != nullptr;
         c = c->NextSiblingElement(what)) {
      named |= is_named(child_of(c, "topics"), "topic", endpoint.topic);
      const XMLElement* partitions = child_of(c, "partitions");
      in_partition |= partitions == nullptr ? endpoint.partition.empty()
                                            : is_named(partitions, "partition", endpoint.partition);
    }
    if (!named) continue;
    if (std::string(rule->Name()) != "allow_rule") return "denies to ";
    if (!has_domain(child_of(rule, "domains"), domain))
      return "does not name domain " + std::to_string(domain) + " where it allows to ";
    if (!in_partition)
      return "does not name partition " +
             (endpoint.partition.empty() ? "\"\" (the default)" : endpoint.partition) +
             " where it allows to ";
    return "";
  }
  return kUnnamed;
}

const XMLElement* grant_for(const XMLDocument& document, const std::string& subject) {
  const XMLElement* permissions = child_of(document.RootElement(), "permissions");
  for (const XMLElement* grant = child_of(permissions, "grant"); grant != nullptr;
       grant = grant->NextSiblingElement("grant"))
    if (text_of(child_of(grant, "subject_name")) == subject) return grant;
  return nullptr;
}

}  // namespace

std::string date_of(std::time_t time) {
  std::tm parts{};
  gmtime_r(&time, &parts);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%S", &parts);
  return text.data();
}

const char* to_string(Role role) {
  switch (role) {
    case Role::kPublisher:
      return "publisher";
    case Role::kSubscriber:
      return "subscriber";
    case Role::kRecorder:
      return "recorder";
  }
  return "";
}

std::vector<Endpoint> endpoints_of(Role role, const TopicNames& names) {
  std::vector<Endpoint> endpoints;
  const auto add = [&](Roles TopicFacts::*who, bool writes) {
    for (TopicPlace place = 0; place < kTopicCount; ++place)
      if (const TopicFacts& topic = kTopicFacts[place]; (topic.*who).has(role))
        endpoints.push_back({names.at(place), writes, topic.has_partitions ? "*" : ""});
  };
  add(&TopicFacts::writers, true);
  add(&TopicFacts::readers, false);
  add(&TopicFacts::listeners, false);
  return endpoints;
}

std::string governance_text(std::uint32_t domain, const std::string& prefix) {
  // Protected once, endpoint by endpoint: the key of a writer goes to its readers alone, so a peer
  // cannot read what is sent to another in its own partition. Message protection would encrypt all
  // again with keys that everybody holds. A writer's readers all hold its key. That of what has few
  // readers also signs for each of them apart, so that none can forge it to another; 20 bytes a
  // reader and message would not fit where there are hundreds.
  const TopicNames names = all_versions(prefix);
  std::string topics;
  for (TopicPlace place = 0; place < kTopicCount; ++place)
    if (kTopicFacts[place].signs_for_each) topics += topic_rule(names.at(place), kSignedForEach);
  topics += topic_rule(prefix + "/*", "ENCRYPT");
  topics += topic_rule("*", "ENCRYPT");  // a host's own: who may use them is in its permissions
  return kHead +
         std::string(
             "omg_shared_ca_governance.xsd\">\n  <domain_access_rules>\n    <domain_rule>\n"
             "      <domains><id>") +
         std::to_string(domain) +
         "</id></domains>\n"
         "      <allow_unauthenticated_participants>false</allow_unauthenticated_participants>\n"
         "      <enable_join_access_control>true</enable_join_access_control>\n"
         "      <discovery_protection_kind>ENCRYPT</discovery_protection_kind>\n"
         "      <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>\n"
         "      <rtps_protection_kind>NONE</rtps_protection_kind>\n"
         "      <topic_access_rules>\n" +
         topics +
         "      </topic_access_rules>\n"
         "    </domain_rule>\n  </domain_access_rules>\n</dds>\n";
}

std::string permissions_text(const SecurityPlan& plan, const SecurityPlan::Identity& identity,
                             std::time_t now) {
  std::string text = kHead +
                     std::string(
                         "omg_shared_ca_permissions.xsd\">\n  <permissions>\n"
                         "    <grant name=\"") +
                     to_string(identity.role) + "\">\n      <subject_name>CN=" + identity.name +
                     "</subject_name>\n      <validity>\n        <not_before>" +
                     date_of(now - kDay_s) + "</not_before>\n        <not_after>" +
                     date_of(now + plan.valid_days * kDay_s) +
                     "</not_after>\n      </validity>\n      <allow_rule>\n"
                     "        <domains><id>" +
                     std::to_string(plan.domain) + "</id></domains>\n";
  std::vector<Endpoint> endpoints = endpoints_of(identity.role, all_versions(plan.prefix));
  for (const bool writes : {true, false})
    for (const std::string& topic : plan.topics) endpoints.push_back({topic, writes, ""});
  add_criteria(text, endpoints);
  return text +
         "      </allow_rule>\n      <default>DENY</default>\n    </grant>\n  </permissions>\n"
         "</dds>\n";
}

std::string judge_governance(const std::string& text, std::uint32_t domain,
                             const std::string& prefix) {
  XMLDocument document;
  if (document.Parse(text.c_str(), text.size()) != tinyxml2::XML_SUCCESS)
    return std::string("is not XML (") + document.ErrorName() + ")";
  const XMLElement* rules = child_of(document.RootElement(), "domain_access_rules");
  for (const XMLElement* rule = child_of(rules, "domain_rule"); rule != nullptr;
       rule = rule->NextSiblingElement("domain_rule")) {
    if (!has_domain(child_of(rule, "domains"), domain)) continue;
    if (text_of(child_of(rule, "allow_unauthenticated_participants")) != "false")
      return "lets in participants without an identity";
    const TopicNames names(prefix);
    for (TopicPlace place = 0; place < kTopicCount; ++place) {
      const XMLElement* topic = child_of(child_of(rule, "topic_access_rules"), "topic_rule");
      while (topic != nullptr && !is_named(topic, "topic_expression", names.at(place)))
        topic = topic->NextSiblingElement("topic_rule");
      if (topic == nullptr) return "has no rule for topic " + names.at(place);
      if (kTopicFacts[place].signs_for_each &&
          text_of(child_of(topic, "metadata_protection_kind")) != kSignedForEach)
        return "has no " + std::string(kSignedForEach) + " for topic " + names.at(place);
    }
    return "";
  }
  return "has no rule for domain " + std::to_string(domain);
}

std::string judge_permissions(const std::string& text, const std::string& subject,
                              std::uint32_t domain, const std::string& prefix, std::time_t now) {
  XMLDocument document;
  if (document.Parse(text.c_str(), text.size()) != tinyxml2::XML_SUCCESS)
    return std::string("is not XML (") + document.ErrorName() + ")";
  const XMLElement* grant = grant_for(document, subject);
  if (grant == nullptr) return "grants nothing to " + subject + ", whom cert.pem names";
  const XMLElement* validity = child_of(grant, "validity");
  const std::string from = text_of(child_of(validity, "not_before")),
                    until = text_of(child_of(validity, "not_after"));
  if (parse_date(from) < 0 || parse_date(until) < 0) return "states no validity";
  if (now < parse_date(from)) return "is not valid before " + from;
  if (now >= parse_date(until)) return "expired on " + until;
  // Of the role that it comes nearest to: whose topics it names, whatever else is wrong with them.
  constexpr std::size_t kUnnamedWeight = 100;
  std::string least;
  std::size_t fewest = 0;
  for (const Role role : kRoles) {
    std::string first;
    std::size_t count = 0;
    for (const Endpoint& endpoint : endpoints_of(role, TopicNames(prefix))) {
      const std::string fault = judge_endpoint(grant, endpoint, domain);
      if (fault.empty()) continue;
      count += fault == kUnnamed ? kUnnamedWeight : 1;
      if (first.empty())
        first = fault + (endpoint.writes ? "publish " : "subscribe to ") + endpoint.topic +
                " (as a " + to_string(role) + " must)";
    }
    if (count == 0) return "";
    if (least.empty() || count < fewest) {
      least = first;
      fewest = count;
    }
  }
  return least;
}

}  // namespace nearmesh::wire
