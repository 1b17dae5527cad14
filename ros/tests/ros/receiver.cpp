// A subscriber on Fast DDS, which shares no code with the publisher's Cyclone DDS. It takes every message as
// bytes and says, a line each: topic, bytes, FNV-1a of the bytes, time of arrival (wall clock, nanoseconds), and
// the first two numbers, which are a stamp in a message that begins with a header.
//
// receiver DOMAIN RECEIVE_BUFFER_BYTES HISTORY HASH TOPIC=TYPE=reliable|best_effort[,transient_local] ...
//
// It says `ready`, then `matched N` when a publisher of topic N is found, and ends when its standard input
// does. HASH is 0 to leave the hash out, which takes time.

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

using namespace eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

static std::mutex output;
static bool hashes;

using Bytes = std::vector<uint8_t>;

// Any type: what comes is kept as it is.
struct Raw : TopicDataType {
    explicit Raw(const std::string &name) {
        setName(name.c_str());
        m_typeSize = 64 << 20;
        m_isGetKeyDefined = false;
    }
    bool serialize(void *, rtps::SerializedPayload_t *) override { return false; }
    bool deserialize(rtps::SerializedPayload_t *payload, void *data) override {
        static_cast<Bytes *>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void *) override {
        return [] { return uint32_t(0); };
    }
    void *createData() override { return new Bytes; }
    void deleteData(void *data) override { delete static_cast<Bytes *>(data); }
    bool getKey(void *, rtps::InstanceHandle_t *, bool) override { return false; }
};

struct Listener : DataReaderListener {
    int number = 0;
    std::mutex taking;
    void on_data_available(DataReader *reader) override {
        // Several threads may call this at once, and would change the order between taking and telling.
        std::lock_guard<std::mutex> one(taking);
        Bytes bytes;
        SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
            auto now = std::chrono::system_clock::now().time_since_epoch();
            if (!info.valid_data) {
                continue;
            }
            uint64_t hash = 0xcbf29ce484222325;
            for (size_t i = 0; hashes && i < bytes.size(); ++i) {
                hash = (hash ^ bytes[i]) * 0x100000001b3;
            }
            std::lock_guard<std::mutex> lock(output);
            int32_t seconds = 0;
            uint32_t nanoseconds = 0;
            if (bytes.size() >= 12) {
                std::memcpy(&seconds, &bytes[4], 4);
                std::memcpy(&nanoseconds, &bytes[8], 4);
            }
            std::printf("%d %zu %016llx %lld %d %u\n", number, bytes.size(), (unsigned long long)hash,
                        (long long)std::chrono::duration_cast<std::chrono::nanoseconds>(now).count(), seconds,
                        nanoseconds);
            // Without hashes this is a measurement, in which the output may come late.
            if (hashes) {
                std::fflush(stdout);
            }
        }
    }
    void on_subscription_matched(DataReader *, const SubscriptionMatchedStatus &status) override {
        if (status.current_count_change > 0) {
            std::lock_guard<std::mutex> lock(output);
            std::printf("matched %d\n", number);
            std::fflush(stdout);
        }
    }
    void on_sample_lost(DataReader *, const SampleLostStatus &status) override {
        std::lock_guard<std::mutex> lock(output);
        std::printf("lost %d %d\n", number, status.total_count);
    }
};

int main(int count, char **arguments) {
    if (count < 6) {
        std::fprintf(stderr, "receiver DOMAIN RECEIVE_BUFFER_BYTES HISTORY HASH TOPIC=TYPE=QOS ...\n");
        return 2;
    }
    const unsigned domain = std::strtoul(arguments[1], nullptr, 10);
    const unsigned history = std::strtoul(arguments[3], nullptr, 10);
    hashes = std::strcmp(arguments[4], "0") != 0;
    DomainParticipantQos participant_qos;
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->receiveBufferSize = std::strtoul(arguments[2], nullptr, 10);
    udp->interfaceWhiteList.push_back("127.0.0.1");
    participant_qos.transport().use_builtin_transports = false;
    participant_qos.transport().user_transports.push_back(udp);
    for (unsigned index = 0; index < 8; ++index) {
        rtps::Locator_t peer;
        rtps::IPLocator::setIPv4(peer, 127, 0, 0, 1);
        peer.port = 7400 + 250 * domain + 10 + 2 * index;
        participant_qos.wire_protocol().builtin.initialPeersList.push_back(peer);
    }
    auto *participant = DomainParticipantFactory::get_instance()->create_participant(domain, participant_qos);
    if (!participant) {
        std::fprintf(stderr, "no participant\n");
        return 1;
    }
    auto *subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    std::vector<std::unique_ptr<Listener>> listeners;
    for (int i = 5; i < count; ++i) {
        const std::string text = arguments[i];
        const size_t first = text.find('='), second = text.find('=', first + 1);
        const std::string name = text.substr(0, first), type = text.substr(first + 1, second - first - 1);
        const std::string qos_text = text.substr(second + 1);
        TypeSupport support(new Raw(type));
        support.register_type(participant);
        auto *topic = participant->create_topic(name, type, TOPIC_QOS_DEFAULT);
        DataReaderQos qos;
        qos.history().kind = KEEP_LAST_HISTORY_QOS;
        qos.history().depth = history;
        qos.resource_limits().max_samples = 0;
        qos.resource_limits().max_samples_per_instance = 0;
        qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        qos.reliability().kind = qos_text.find("best_effort") == std::string::npos
                                     ? RELIABLE_RELIABILITY_QOS
                                     : BEST_EFFORT_RELIABILITY_QOS;
        if (qos_text.find("transient_local") != std::string::npos) {
            qos.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
        }
        listeners.push_back(std::make_unique<Listener>());
        listeners.back()->number = i - 5;
        if (!subscriber->create_datareader(topic, qos, listeners.back().get())) {
            std::fprintf(stderr, "no reader for %s\n", name.c_str());
            return 1;
        }
    }
    std::printf("ready\n");
    std::fflush(stdout);
    char byte;
    while (read(0, &byte, 1) > 0) {
    }
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
    return 0;
}
