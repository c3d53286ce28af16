// The form for the room's key or a personal token. What is typed goes to the room object alone.
import type { State } from "../state";
import type { Room } from "../wire/room";
import { find, setText } from "./dom";

// What the gateway says (client/web/http/routes.cpp), for guests.
function inWords(why: string): string {
  return why === "wrong key" ? "This key is wrong. Ask your host for a new link." : why;
}

export function showLogin(state: State, room: Room): void {
  const dialog = find<HTMLDialogElement>("login");
  const secret = find<HTMLInputElement>("login-secret");
  const error = find("login-error");
  const go = find<HTMLButtonElement>("login-go");
  const isToken = find<HTMLInputElement>("login-by-token");
  const visible = find<HTMLInputElement>("login-visible");

  const update = () => {
    const isShown = go.disabled || state.link === "login";
    if (isShown && !dialog.open) {
      if (state.linkWhy) setText(error, inWords(state.linkWhy));
      dialog.showModal();
      secret.focus();
    }
    if (!isShown && dialog.open) {
      dialog.close();
      secret.value = "";
    }
  };

  const submit = async () => {
    const typed = secret.value.trim();
    if (!typed) {
      setText(error, "Type the key or the token first.");
      secret.focus();
      return;
    }
    go.disabled = true; // while the gateway is asked
    setText(error, "");
    await room.login(isToken.checked ? { token: typed } : { room: typed }).catch((refusal: Error) => {
      setText(error, inWords(refusal.message));
      secret.select();
    });
    go.disabled = false;
    update();
  };

  find("login-form").addEventListener("submit", (event) => {
    event.preventDefault();
    if (!go.disabled) void submit();
  });
  visible.addEventListener("change", () => (secret.type = visible.checked ? "text" : "password"));
  // There is nothing behind the form.
  dialog.addEventListener("cancel", (event) => event.preventDefault());
  dialog.addEventListener("close", update); // browsers close it after the third Escape all the same
  state.on("link", update);
  // The page may log in by its link first.
  requestAnimationFrame(update);
}
