"""A subscriber on PyPI's eclipse-zenoh, set up as `rmw_zenoh` sets up its sessions, and a router beside it.

zenoh_subscriber.py PORT DOMAIN [TOKEN ...]

Runs a router at PORT and a peer that finds others by it, declares the liveliness TOKENs with SESSION in them
replaced by its own session, says `ready`, and listens until its standard input ends. It says `token KEY` for
each token that comes, and `message KEY` for each message. The answer is one line of JSON: the tokens, and of every key its messages in order,
each with the SHA-256 of its bytes and its attachment, decoded by Zenoh's own serialisation.
"""

import hashlib
import json
import sys
import threading
import time

import xxhash
import zenoh
import zenoh.ext


def config(mode, **settings):
    made = zenoh.Config()
    made.insert_json5("mode", json.dumps(mode))
    made.insert_json5("scouting/multicast/enabled", "false")
    made.insert_json5("timestamping/enabled", "true")
    for key, value in settings.items():
        made.insert_json5(key.replace("__", "/"), json.dumps(value))
    return made


def main():
    port, domain, tokens = sys.argv[1], sys.argv[2], sys.argv[3:]
    router = zenoh.open(config("router", listen__endpoints=[f"tcp/127.0.0.1:{port}"]))
    peer = zenoh.open(
        config("peer", connect__endpoints=[f"tcp/127.0.0.1:{port}"], listen__endpoints=["tcp/127.0.0.1:0"])
    )
    lock, here, came, over = threading.Lock(), {}, {}, threading.Event()

    def note(sample):
        key = str(sample.key_expr)
        with lock:
            if over.is_set():
                return
            if sample.kind == zenoh.SampleKind.PUT:
                identity = xxhash.xxh3_128(key.encode()).intdigest().to_bytes(16, "little")
                here[key] = identity.hex()
                print("token", key, flush=True)
            else:
                here.pop(key, None)
                print("gone", key, flush=True)

    def take(sample):
        attachment = [zenoh.ext.Int64, zenoh.ext.Int64, bytes]
        number, sent_ns, identity = zenoh.ext.z_deserialize(tuple[*attachment], sample.attachment)
        with lock:
            if not over.is_set():
                print("message", sample.key_expr, flush=True)
            came.setdefault(str(sample.key_expr), []).append(
                {
                    "sha256": hashlib.sha256(sample.payload.to_bytes()).hexdigest(),
                    "number": int(number),
                    "sent_ns": int(sent_ns),
                    "gid": identity.hex(),
                }
            )

    keep = [peer.liveliness().declare_token(token.replace("SESSION", str(peer.info.zid()))) for token in tokens]
    # As rmw_zenoh subscribes to what is latched; for all else it is an ordinary subscriber.
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
    recovery = zenoh.ext.RecoveryConfig(heartbeat=True)
    keep.append(
        zenoh.ext.declare_advanced_subscriber(peer, f"{domain}/**", take, history=history, recovery=recovery)
    )
    print("ready", flush=True)
    keep.append(peer.liveliness().declare_subscriber(f"@ros2_lv/{domain}/**", note, history=True))
    sys.stdin.read()
    # What is on its way comes within a moment.
    count = -1
    while count != (count := sum(len(messages) for messages in came.values())):
        time.sleep(0.5)
    with lock:
        print(json.dumps({"tokens": here, "messages": came}), flush=True)
        # Nothing is said behind the answer.
        over.set()
    del keep
    peer.close()
    router.close()


main()
