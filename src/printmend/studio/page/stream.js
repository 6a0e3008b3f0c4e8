// One stream of events for all tabs of a browser: it opens no more than six connections to a server, and a stream holds
// one for as long as its job runs. Runs as a shared worker; a tab tells it which jobs it follows.
const followed = new Map(); // of each job the ports of the tabs that follow it
let source = null;

const tell = (message, key) => { for (const port of key ? followed.get(key) ?? [] : new Set([...followed.values()].flatMap((ports) => [...ports]))) port.postMessage(message); };

function hear(job) {
  tell({ job }, job.id);
  if (["done", "failed", "cancelled"].includes(job.state)) followed.delete(job.id);
  if (!followed.size) close();
}

function close() { source?.close(); source = null; }

function open() {
  close();
  if (!followed.size) return;
  source = new EventSource(`/api/v1/jobs/events?${[...followed.keys()].map((key) => `key=${key}`).join("&")}`);
  source.addEventListener("job", (event) => hear(JSON.parse(event.data)));
  source.onerror = () => {
    if (source?.readyState !== EventSource.CLOSED) return tell({ away: true }); // the browser itself tries again
    close();
    setTimeout(async () => { // the server says no: some jobs may be gone
      for (const key of [...followed.keys()]) {
        const answer = await fetch(`/api/v1/jobs/${key}`).catch(() => null);
        if (answer?.ok) hear(await answer.json());
        else if (answer?.status === 404) followed.delete(key);
      }
      if (!source) open();
    }, 1000);
  };
}

onconnect = ({ ports: [port] }) => {
  port.onmessage = ({ data: { follow, leave } }) => {
    if (follow) {
      if (!followed.has(follow)) followed.set(follow, new Set());
      followed.get(follow).add(port);
      open(); // says at once how all of them are
    }
    if (leave) {
      followed.get(leave)?.delete(port);
      if (!followed.get(leave)?.size) followed.delete(leave);
      if (!followed.size) close();
    }
  };
};
