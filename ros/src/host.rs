//! Limits of this machine's network that make large messages get lost.

/// Receive buffer for a message of 4 MB. By default Linux allows 208 KiB.
pub const ADVISED_RECEIVE_BUFFER_BYTES: u64 = 4 << 20;

/// Largest receive buffer that a program may ask for (`net.core.rmem_max`), bytes.
#[must_use]
pub fn receive_buffer_limit_bytes() -> Option<u64> {
    std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok()?.trim().parse().ok()
}

/// Datagrams that this machine has discarded since it started because the receive buffer of any program was
/// full.
#[must_use]
pub fn datagrams_lost() -> Option<u64> {
    lost(&std::fs::read_to_string("/proc/net/snmp").ok()?)
}

/// The count in `/proc/net/snmp`, which has a line of names above a line of numbers.
fn lost(snmp: &str) -> Option<u64> {
    let mut lines = snmp.lines().filter(|line| line.starts_with("Udp: "));
    let (names, numbers) = (lines.next()?, lines.next()?);
    let column = names.split_whitespace().position(|name| name == "RcvbufErrors")?;
    numbers.split_whitespace().nth(column)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_datagrams_are_found_by_name() {
        let text =
            "Ip: A B\nIp: 1 2\nUdp: InDatagrams RcvbufErrors\nUdp: 5 7\nUdpLite: RcvbufErrors\nUdpLite: 9\n";
        assert_eq!((lost(text), lost("Udp: x\nUdp: 1\n")), (Some(7), None));
    }
}
