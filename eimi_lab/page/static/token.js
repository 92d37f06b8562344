// The token that every request must carry. It comes in the fragment of the address and is kept in this tab's sessionStorage.
const fragment = /^#token=([\w-]+)(#.*)?$/.exec(location.hash);
if (fragment) {
  sessionStorage.setItem("token", fragment[1]);
  history.replaceState(null, "", location.pathname + (fragment[2] ?? ""));
}
export const token = sessionStorage.getItem("token") ?? "";
