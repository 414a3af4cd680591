// The socket to the server: the token, messages both ways, and coming back after a break.

const FIRST_PAUSE = 500, LONGEST_PAUSE = 5000; // milliseconds
const NOT_KNOWN = 4401, TOO_MANY = 4429, ELSEWHERE = 4409;

const FINAL = {
  [NOT_KNOWN]: "The server does not know this page's token. Open the address that `pcsg view` printed.",
  [TOO_MANY]: "There are too many windows already. Close one and load this page again.",
  [ELSEWHERE]: "This window was opened a second time, and goes on there.",
};

// The token comes in the address's fragment, which no server sees, and leaves it at once.
function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    sessionStorage.setItem("token", given);
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem("token");
}

function windowName() {
  let name = sessionStorage.getItem("window");
  if (!name) {
    name = Array.from(crypto.getRandomValues(new Uint8Array(12)), (b) => b.toString(16).padStart(2, "0")).join("");
    sessionStorage.setItem("window", name);
  }
  return name;
}

// A picture comes as the lengths of its two heads, what is said about it, distances, a file's bytes.
function unpack(buffer) {
  const lengths = new DataView(buffer);
  const said = lengths.getUint32(0, true), measured = lengths.getUint32(4, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, said)));
  head.depth = new Float32Array(buffer.slice(8 + said, 8 + said + measured));
  head.blob = new Blob([new Uint8Array(buffer, 8 + said + measured)], { type: head.kind });
  return head;
}

export class Link {
  // `hear` gets every message, `tell` what state the connection is in.
  constructor(hear, tell) {
    this.hear = hear;
    this.tell = tell;
    this.token = takeToken();
    this.pause = FIRST_PAUSE;
    if (this.token) this.open();
    else tell("closed", FINAL[NOT_KNOWN]);
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = (this.socket = new WebSocket(`${scheme}//${location.host}/ws`));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      socket.send(JSON.stringify({ token: this.token, window: windowName() }));
    };
    socket.onmessage = (event) => {
      this.pause = FIRST_PAUSE;
      this.hear(typeof event.data === "string" ? JSON.parse(event.data) : unpack(event.data));
    };
    socket.onclose = (event) => {
      if (FINAL[event.code]) {
        this.tell("closed", FINAL[event.code]);
        return;
      }
      this.tell("broken", "The server does not answer. Trying again; if it was ended, start `pcsg view` again.");
      setTimeout(() => this.open(), this.pause);
      this.pause = Math.min(2 * this.pause, LONGEST_PAUSE);
    };
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  send(message) {
    if (this.isOpen) this.socket.send(JSON.stringify(message));
  }
}
