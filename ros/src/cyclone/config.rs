//! The network to publish on: ROS 2's environment variables, and the configuration of Cyclone DDS that
//! follows from them.

use crate::transport::TransportError;
use std::fmt::Write as _;

/// Largest domain id; larger ones have no ports.
pub const MAX_DOMAIN: u32 = 232;

/// The network to publish on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkOptions {
    /// Domain, 0 to [`MAX_DOMAIN`].
    pub domain: u32,
    /// Name of the network interface. `None`: Cyclone chooses.
    pub interface: Option<String>,
    /// Whether to stay on this machine.
    pub localhost_only: bool,
    /// Name of the node.
    pub node: String,
    /// ROS 2 distribution of the subscribers. `humble` and older ones have a different graph message.
    pub distribution: String,
}

impl NetworkOptions {
    /// Reads ROS 2's environment variables: `ROS_DOMAIN_ID`, `ROS_LOCALHOST_ONLY`,
    /// `ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_DISTRO`. `get` reads a variable.
    pub fn from_environment(get: impl Fn(&str) -> Option<String>) -> Result<Self, TransportError> {
        let set = |name: &str| get(name).filter(|value| !value.is_empty());
        let domain = match set("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => text.trim().parse().map_err(|_| {
                let expected = format!("expected a number from 0 to {MAX_DOMAIN}");
                TransportError::Unavailable(format!("ROS_DOMAIN_ID is `{text}`, {expected}"))
            })?,
        };
        let range = set("ROS_AUTOMATIC_DISCOVERY_RANGE");
        if range.as_deref() == Some("OFF") {
            let reason = "ROS_AUTOMATIC_DISCOVERY_RANGE is OFF, so nobody could find the topics";
            return Err(TransportError::Unavailable(reason.to_owned()));
        }
        Ok(NetworkOptions {
            domain,
            interface: None,
            localhost_only: set("ROS_LOCALHOST_ONLY").as_deref() == Some("1")
                || range.as_deref() == Some("LOCALHOST"),
            node: "esaac".to_owned(),
            distribution: set("ROS_DISTRO").unwrap_or_else(|| "jazzy".to_owned()),
        })
    }

    /// Whether the distribution's types have hashes; all have since Iron.
    pub(crate) fn has_type_hashes(&self) -> bool {
        !["foxy", "galactic", "humble"].contains(&self.distribution.as_str())
    }

    /// Size of an entity's identity in the ROS graph.
    pub(super) fn gid_bytes(&self) -> usize {
        if self.has_type_hashes() { 16 } else { 24 }
    }

    /// Cyclone's configuration. `user` is the user's own (`CYCLONEDDS_URI`); it comes last and overrides
    /// ours.
    pub(super) fn xml(&self, user: Option<&str>) -> String {
        let mut general = String::new();
        // Cyclone refuses a second list of interfaces.
        let users_own = user.is_some_and(|user| user.contains("<NetworkInterface"));
        let loopback = (self.localhost_only && !users_own).then_some("lo");
        let interface = self.interface.as_deref().or(loopback);
        if let Some(name) = interface {
            let name = escape(name);
            let _ = write!(general, "<Interfaces><NetworkInterface name=\"{name}\"/></Interfaces>");
        }
        if self.localhost_only {
            general += "<AllowMulticast>false</AllowMulticast>";
        }
        // The largest datagrams: an event packet takes a few system calls instead of hundreds.
        general += "<MaxMessageSize>65500B</MaxMessageSize><FragmentSize>65000B</FragmentSize>";
        // A lost discovery message is repeated soon. A demo may end before the default 30 s.
        let mut discovery = "<SPDPInterval>2s</SPDPInterval>\
                             <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
            .to_owned();
        if self.localhost_only {
            discovery += "<ParticipantIndex>auto</ParticipantIndex>\
                          <Peers><Peer address=\"localhost\"/></Peers>";
        }
        // A writer keeps its whole history and never stops for one slow reader. A heartbeat asks readers what
        // they have after every tick. The default is a heartbeat after 0.1 s without a message, and at 30
        // ticks a second there is no such pause: losses would be found late, and delivered messages kept for
        // good.
        let internal = "<Watermarks><WhcHigh>512MB</WhcHigh><WhcHighInit>512MB</WhcHighInit>\
                        <WhcAdaptive>false</WhcAdaptive></Watermarks>\
                        <HeartbeatInterval minsched=\"10ms\">10ms</HeartbeatInterval>";
        let mut xml = format!(
            "<CycloneDDS><Domain Id=\"any\"><General>{general}</General><Discovery>{discovery}</Discovery>\
             <Internal>{internal}</Internal></Domain></CycloneDDS>"
        );
        if let Some(user) = user.filter(|user| !user.is_empty()) {
            xml.push(',');
            xml += user;
        }
        xml
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(variables: &'static [(&str, &str)]) -> Result<NetworkOptions, TransportError> {
        NetworkOptions::from_environment(|name| {
            variables.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn the_environment_is_read_as_ros_reads_it() {
        let options = from(&[("ROS_DOMAIN_ID", "42"), ("ROS_DISTRO", "humble")]).unwrap();
        assert_eq!((options.domain, options.localhost_only, options.gid_bytes()), (42, false, 24));
        assert!(from(&[("ROS_LOCALHOST_ONLY", "1")]).unwrap().localhost_only);
        let local = from(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")]).unwrap();
        assert!(local.localhost_only && local.xml(None).contains("name=\"lo\""));
        assert_eq!(from(&[("ROS_DOMAIN_ID", "")]).unwrap().domain, 0);
        assert!(from(&[("ROS_DOMAIN_ID", "x")]).unwrap_err().to_string().contains("`x`"));
        assert!(from(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")]).unwrap_err().to_string().contains("OFF"));
    }

    #[test]
    fn the_users_configuration_comes_last() {
        let options = NetworkOptions { interface: Some("a\"b".to_owned()), ..from(&[]).unwrap() };
        let xml = options.xml(Some("file:///mine.xml"));
        assert!(xml.ends_with("</CycloneDDS>,file:///mine.xml") && xml.contains("a&quot;b"), "{xml}");
        let local = NetworkOptions { localhost_only: true, ..from(&[]).unwrap() };
        let xml = local.xml(Some("<CycloneDDS><NetworkInterface name='lo'/></CycloneDDS>"));
        assert_eq!(xml.matches("<NetworkInterface").count(), 1, "{xml}");
    }
}
