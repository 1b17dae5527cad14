//! The node under test, and another one that looks at it.

use crate::world;
use esaac_ros::{NodeOptions, RclrsTransport};
use rclrs::{
    Context, CreateBasicExecutor, Executor, InitOptions, Node, Promise, RclrsErrorFilter, SpinOptions,
};

/// The node on `domain`, with `arguments` of ROS 2.
pub fn open(domain: u32, arguments: &[&str]) -> Result<RclrsTransport, String> {
    keeps_to_loopback();
    let arguments = arguments.iter().map(|&argument| argument.to_owned()).collect();
    let options = NodeOptions { domain: Some(domain), node: "esaac".to_owned(), arguments };
    RclrsTransport::open(&options).map_err(|error| error.to_string())
}

fn keeps_to_loopback() {
    let is = |name: &str, value: &str| std::env::var(name).is_ok_and(|actual| actual == value);
    assert!(
        is("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST") || is("ROS_LOCALHOST_ONLY", "1"),
        "expected ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, or ROS_LOCALHOST_ONLY=1 for Humble; tools/test.sh sets both"
    );
}

/// A node of another program, as it were.
pub struct Observer {
    pub node: Node,
    executor: Executor,
}

impl Observer {
    pub fn on(domain: u32) -> Self {
        let options = InitOptions::new().with_domain_id(Some(domain as usize));
        let context = Context::new(["observer".to_owned()], options).expect("the ROS 2 that is sourced");
        let executor = context.create_basic_executor();
        let node = executor.create_node("observer").expect("a good name");
        Observer { node, executor }
    }

    /// Works until `promise` is kept, which must happen soon.
    pub fn wait<T: Send + 'static>(&mut self, promise: Promise<T>) -> T {
        let (mut promise, notice) = self.executor.commands().create_notice(promise);
        let options = SpinOptions::new().until_promise_resolved(notice).timeout(world::PATIENCE);
        self.executor.spin(options).first_error().expect("it spins");
        promise.try_recv().ok().flatten().expect("an answer in time")
    }

    /// Waits until `is_so`, which is asked whenever the graph may have changed.
    pub fn wait_until(&mut self, is_so: impl FnMut() -> bool + Send + 'static) {
        let period = std::time::Duration::from_millis(10);
        let promise = self.node.notify_on_graph_change_with_period(period, is_so);
        self.wait(promise);
    }
}
