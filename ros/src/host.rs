//! What this machine's network does to large messages.

/// Receive buffer that a message of 4 MB needs. Stock Linux allows 208 KiB.
pub const ADVISED_RECEIVE_BUFFER_BYTES: u64 = 4 << 20;

/// Largest receive buffer that a program may ask for (`net.core.rmem_max`), bytes.
#[must_use]
pub fn receive_buffer_limit_bytes() -> Option<u64> {
    std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok()?.trim().parse().ok()
}

/// Datagrams that this machine has thrown away since it started because a program's receive buffer was
/// full, whichever program it was.
#[must_use]
pub fn datagrams_lost() -> Option<u64> {
    lost(&std::fs::read_to_string("/proc/net/snmp").ok()?)
}

/// The figure in `/proc/net/snmp`: a line of names and one of numbers.
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
