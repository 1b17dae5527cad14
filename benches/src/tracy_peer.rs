//! The least of a Tracy profiler: it makes the protocol's handshake and reads the stream.

use anyhow::{Context, Result, bail, ensure};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Version of the protocol that the linked client speaks.
const PROTOCOL: u32 = 82;

/// The first bytes of a profiler.
const GREETING: &[u8] = b"TracyPrf";

/// The client's answer to a greeting in its own version.
const WELCOME: u8 = 1;

/// Bytes of the client's introduction, and of its addition for a profiler that connects on demand.
const INTRODUCTION: usize = 1170;
const ON_DEMAND: usize = 16;

/// Ports that a client may listen on: the first one and their number. `TRACY_PORT` overrides them.
const PORTS: (u16, u16) = (8086, 20);

/// Largest block of the stream, in unpacked bytes.
const BLOCK_BYTES: usize = 256 * 1024;

/// A connected profiler. A thread reads its stream.
pub struct Peer {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<Vec<u8>>>,
    /// Name of the client's program, from its introduction.
    pub program: String,
}

impl Peer {
    /// Connects to this process's own client.
    pub fn connect() -> Result<Self> {
        let mut stream = find()?;
        let mut introduction = [0; INTRODUCTION];
        stream.read_exact(&mut introduction).context("the client's introduction")?;
        let mut on_demand = [0; ON_DEMAND];
        stream.read_exact(&mut on_demand).context("what the client adds on demand")?;
        let name = &introduction[82..146];
        let program =
            String::from_utf8_lossy(name.split(|&b| b == 0).next().unwrap_or_default()).into_owned();
        let stop = Arc::new(AtomicBool::new(false));
        let thread = {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || drain(stream, &stop))
        };
        wait_until_connected()?;
        Ok(Peer { stop, thread, program })
    }

    /// Disconnects and returns everything it read, unpacked.
    pub fn read(self) -> Result<Vec<u8>> {
        // The client sends what it has buffered within some milliseconds.
        std::thread::sleep(Duration::from_millis(200));
        self.stop.store(true, Ordering::Relaxed);
        match self.thread.join() {
            Ok(read) => read,
            Err(_) => bail!("the thread that reads from the client has panicked"),
        }
    }

    /// Disconnects and returns the number of bytes it read.
    pub fn finish(self) -> Result<usize> {
        Ok(self.read()?.len())
    }
}

/// Connects to the client and makes the handshake.
fn find() -> Result<TcpStream> {
    let asked = std::env::var("TRACY_PORT").ok().and_then(|port| port.parse::<u16>().ok());
    let ports = match asked {
        Some(port) => port..port + 1,
        None => PORTS.0..PORTS.0 + PORTS.1,
    };
    // Another program on this machine may have a client too, and may answer. The caller then fails in
    // `wait_until_connected`, because this process's client is not connected.
    let started = Instant::now();
    while started.elapsed() < Duration::from_secs(10) {
        for port in ports.clone() {
            let Ok(mut stream) = TcpStream::connect(("127.0.0.1", port)) else { continue };
            stream.set_read_timeout(Some(Duration::from_secs(2)))?;
            stream.write_all(GREETING)?;
            stream.write_all(&PROTOCOL.to_le_bytes())?;
            let mut answer = [0];
            if stream.read_exact(&mut answer).is_err() {
                continue;
            }
            ensure!(
                answer[0] == WELCOME,
                "the client on port {port} answers {}, expected {WELCOME}: another version than {PROTOCOL}?",
                answer[0]
            );
            return Ok(stream);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    bail!("no Tracy client answers on ports {ports:?} of this machine")
}

fn wait_until_connected() -> Result<()> {
    let started = Instant::now();
    while started.elapsed() < Duration::from_secs(5) {
        if esaac_engine::profile::tracy_client::Client::is_connected() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    bail!("the client has answered, but is not connected: it is another program's")
}

/// Reads blocks of LZ4. Each block uses the bytes before it as its dictionary.
fn drain(mut stream: TcpStream, stop: &AtomicBool) -> Result<Vec<u8>> {
    stream.set_read_timeout(Some(Duration::from_millis(50)))?;
    let mut packed: Vec<u8> = Vec::new();
    let mut all: Vec<u8> = Vec::new();
    let mut buffer = vec![0; BLOCK_BYTES];
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => return Ok(all),
            Ok(bytes) => packed.extend_from_slice(&buffer[..bytes]),
            Err(error)
                if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) =>
            {
                if stop.load(Ordering::Relaxed) {
                    return Ok(all);
                }
            }
            Err(error) => return Err(error).context("reading from the client"),
        }
        let mut at = 0;
        while let Some(size) = packed.get(at..at + 4) {
            let size = u32::from_le_bytes(size.try_into().expect("four bytes")) as usize;
            let Some(block) = packed.get(at + 4..at + 4 + size) else { break };
            let dictionary = &all[all.len().saturating_sub(64 * 1024)..];
            let unpacked = lz4_flex::block::decompress_with_dict(block, BLOCK_BYTES, dictionary)
                .context("a block of the client's stream")?;
            all.extend_from_slice(&unpacked);
            at += 4 + size;
        }
        packed.drain(..at);
        if stop.load(Ordering::Relaxed) && packed.is_empty() {
            return Ok(all);
        }
    }
}
