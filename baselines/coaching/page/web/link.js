// The way to this computer's server: the token of its present start, what it offers, and a websocket.

export const UNREACHABLE = 'The coach cannot be reached. Is it still running? I keep trying.';
export const AGAIN = 2000; // between two tries to reach the coach [ms]
const STRANGE = 'This address is not complete, or of an earlier start. Please open the address that the coach '
  + 'printed when it was started; it has ?token= in it.';

let token = new URLSearchParams(location.search).get('token') ?? sessionStorage.getItem('token') ?? '';

export function ours(path) {
  return `${path}?token=${encodeURIComponent(token)}`;
}

// What the coach offers, asked until it answers; undefined where this page is not of its present start.
export async function ask(alarm) {
  let answer;
  while (!answer) {
    try {
      answer = await fetch(ours('/setting'));
    } catch {
      alarm(UNREACHABLE);
      await new Promise((done) => { setTimeout(done, AGAIN); });
    }
  }
  history.replaceState(null, '', location.pathname); // the token is no business of who looks at the screen
  if (!answer.ok) {
    alarm(answer.status === 403 ? STRANGE : `The coach does not answer as it should (${answer.status}).`);
    return undefined;
  }
  const setting = await answer.json();
  token = setting.token;
  sessionStorage.setItem('token', token); // of this tab, so that it can be loaded again
  return setting;
}

export function session() {
  const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
  return new WebSocket(`${scheme}://${location.host}${ours('/session')}`);
}
