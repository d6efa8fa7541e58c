// A word that is spoken, for who has both hands in the scene.
// Only where the browser recognises speech by itself: what is said leaves no machine.

const LANGUAGE = 'en-US';

/** The recogniser of this browser, or null where it has none that works without a network. */
export async function localRecogniser() {
  const Kind = globalThis.SpeechRecognition;
  if (!Kind?.available) return null;
  const state = await Kind.available({ langs: [LANGUAGE], processLocally: true }).catch(() => 'unavailable');
  if (state !== 'available') return null;
  const recogniser = new Kind();
  recogniser.processLocally = true;
  recogniser.continuous = true;
  recogniser.lang = LANGUAGE;
  return recogniser;
}

/** Calls `heard` each time that `word` is spoken, until the returned function is called. `ended` is told why if it stops by itself. */
export function listenFor(recogniser, word, heard, ended) {
  let going = true;
  recogniser.onresult = ({ results, resultIndex }) => {
    for (let i = resultIndex; i < results.length; i++) {
      if (results[i].isFinal && new RegExp(`\\b${word}\\b`, 'i').test(results[i][0].transcript)) heard();
    }
  };
  recogniser.onerror = ({ error }) => {
    if (error === 'no-speech' || error === 'aborted') return;
    going = false;
    ended(error);
  };
  recogniser.onend = () => going && recogniser.start(); // it ends by itself after a silence
  recogniser.start();
  return () => {
    going = false;
    recogniser.stop();
  };
}
